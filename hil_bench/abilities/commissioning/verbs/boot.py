"""`hil-bench boot`: boot a network as its NMT master."""

import argparse
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from hil_bench.abilities.common import arguments as common
from hil_bench.abilities.common.controller_side import open_network
from hil_bench.abilities.common.files import whole_file
from hil_bench.bench.configuration import BenchConfig
from hil_bench.canopen_device.eds import load_eds
from hil_bench.cli import arguments
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import add_json_argument, is_silent, print_lines, print_results
from hil_bench.config.document import Document, Sort, Tables
from hil_bench.config.objects import name_object, objects, override_defaults, parse_object
from hil_bench.config.settings import Key, Problems, convert
from hil_bench.config.values import boolean, choice, describe, integer, number, text, zero_or
from hil_bench.errors import ConfigError, about_file
from hil_bench.units import MILLISECOND, SECOND
from hil_drivers import Network
from hil_drivers.boot import NetworkManager
from hil_drivers.boot_records import BootResult, Loss, Slave, Start, Startup
from hil_drivers.concise_dcf import (
    ConciseEntry,
    convert_dcf,
    order_writes,
    pack_concise_dcf,
    read_concise_dcf,
)
from hil_drivers.eds import load_eds as load_loosely
from hil_drivers.errors import DriverError
from hil_drivers.network import CONTROLLER_ID

# The keys of a network that a master boots: name, unit, default; docs/commissioning.md.

_U32: Final = 0xFFFF_FFFF
_EPOCH: Final = datetime(1984, 1, 1)  # noqa: DTZ001 - CiA 301 has no time zone
_LAST: Final = datetime(2100, 1, 1)  # noqa: DTZ001


def moment(value: object) -> datetime:
    """Return a local date and time.

    Raises:
        ConfigError: the value is something else.
    """
    right = "give a date and time without zone, as in 2026-11-22T13:45:00"
    if not isinstance(value, datetime) or value.tzinfo is not None:
        raise ConfigError(f"{describe(value)} is no such time; {right}")
    if not _EPOCH < value < _LAST:
        raise ConfigError(f"{value.isoformat()} is out of range; {right}, from 1984 to 2099")
    return value


def days_and_milliseconds(time: datetime) -> tuple[int, int]:
    """Return a time as 0x1F26 and 0x1F27 hold it: days since 1984-01-01, ms after midnight."""
    passed = time - _EPOCH
    return passed.days, passed.seconds * 1000 + passed.microseconds // 1000


def _milliseconds(name: str, field: str) -> Key:
    read = zero_or(number(MILLISECOND, low=1.0, high=65535.0))
    return Key(name, read, 0.0, MILLISECOND, field)


def _unsigned32(name: str) -> Key:
    return Key(name, integer(0, _U32))


MASTER_KEYS: Final = (
    Key("node_id", integer(1, 127), CONTROLLER_ID),
    _milliseconds("heartbeat_ms", "heartbeat"),
    Key("start", choice([start.value for start in Start]), Start.EACH.value),
    Key("on_loss", choice([loss.value for loss in Loss]), Loss.SLAVE.value),
    Key("boot_time_s", zero_or(number(SECOND, low=0.1, high=86400.0)), 10.0, SECOND, "boot_time"),
)

IDENTITY_KEYS: Final = ("vendor_id", "product_code", "revision_number", "serial_number")

SLAVE_KEYS: Final = (
    Key("node_id", integer(1, 127), example="1"),
    Key("eds", text),
    Key("mandatory", boolean, default=True),
    Key("boot", boolean, default=True, field="boots"),
    Key("keep_alive", boolean, default=False),
    _unsigned32("device_type"),
    *(_unsigned32(name) for name in IDENTITY_KEYS),
    _milliseconds("heartbeat_time_ms", "heartbeat_time"),
    Key("dcf", text),
    Key("concise_dcf", text),
    Key("objects", objects, {}),
    Key("configured", moment),
    Key("store", boolean, default=False),
    Key("restore", integer(0, 127), 0),
)


# The network that a master is to boot, from a file or from a bench.

BOOT_TIME: Final = 10.0
"""Longest time until the nodes of a bench are booted [s]."""


@dataclass(frozen=True, slots=True)
class BootPlan:
    """A network and its master.

    Attributes:
        node_id: of the master.
        heartbeat: time between two heartbeats of the master [s]; 0 for none.
        startup: how the master boots.
        slaves: the network list, in the order of the file.
    """

    node_id: int
    heartbeat: float
    startup: Startup
    slaves: tuple[Slave, ...]


def plan_of_bench(config: BenchConfig) -> BootPlan:
    """Return the boot plan of a bench: all nodes mandatory, identity by EDS, not configured."""
    slaves = []
    for node in config.nodes:
        device_type, identity = _identity_of(node.eds, node.node_id)
        if node.serial_number:
            identity = (*identity[:3], node.serial_number)
        slaves.append(Slave(node.node_id, node.name, device_type=device_type, identity=identity))
    return BootPlan(CONTROLLER_ID, 0.0, Startup(boot_time=BOOT_TIME), tuple(slaves))


def load_boot_plan(path: Path) -> BootPlan:
    """Return the network of a file; every problem of its keys is told at once, a line each."""
    file = Tables.of_file(path, Sort.NETWORK, ("master", "slaves"))
    problems = file.problems
    master, tables = file.table("master", MASTER_KEYS), file.named("slaves", SLAVE_KEYS)
    if not tables:
        problems.add(problems.source, "has no slaves; give tables such as [slaves.valve]")
    problems.raise_any()
    values = convert(master, MASTER_KEYS)
    slaves: dict[int, Slave] = {}
    for name, table in tables.items():
        place = problems.place(f"slaves.{name}")
        try:
            slave = _slave(path, name, convert(table, SLAVE_KEYS), place)
        except ConfigError as error:
            problems.add(place, str(error).removeprefix(f"{place}: "))
        except DriverError as error:
            problems.add(place, error)
        else:
            _check_node_id(slave, values["node_id"], slaves, problems, place)
            slaves[slave.node_id] = slave
    problems.raise_any()
    return BootPlan(
        values["node_id"],
        values["heartbeat"],
        Startup(Start(values["start"]), Loss(values["on_loss"]), values["boot_time"]),
        tuple(slaves.values()),
    )


def _check_node_id(
    slave: Slave, master: int, known: Mapping[int, Slave], problems: Problems, place: str
) -> None:
    if slave.node_id == master:
        problems.add(f"{place}.node_id", f"{master} is the master's; give another one")
    elif slave.node_id in known:
        other = known[slave.node_id].name
        problems.add(f"{place}.node_id", f"{slave.node_id} is that of {other}; give another one")


def _slave(path: Path, name: str, values: dict[str, Any], place: str) -> Slave:
    """Return a slave.

    Raises:
        ConfigError: what it gives does not fit together.
    """
    node_id = values["node_id"]
    files = {key: None if values[key] is None else path.parent / values[key] for key in _FILES}
    described = files["eds"] or files["dcf"]
    device_type, identity = (0, (0, 0, 0, 0))
    if described is not None:
        device_type, identity = _identity_of(described, node_id)
    given = (values[key] for key in IDENTITY_KEYS)
    vendor, product, revision, serial = (
        known if own is None else own for own, known in zip(given, identity, strict=True)
    )
    configuration = _configuration(files, values["objects"], node_id, place)
    time = values["configured"]
    if time is not None and not configuration:
        raise ConfigError("configured: there is no configuration; give dcf, concise_dcf or objects")
    date, milliseconds = (0, 0) if time is None else days_and_milliseconds(time)
    return Slave(
        node_id,
        name,
        mandatory=values["mandatory"],
        boots=values["boots"],
        keep_alive=values["keep_alive"],
        device_type=device_type if values["device_type"] is None else values["device_type"],
        identity=(vendor, product, revision, serial),
        configuration=configuration,
        date=date,
        time=milliseconds,
        store=values["store"],
        restore=values["restore"],
        heartbeat_time=values["heartbeat_time"],
    )


_FILES: Final = ("eds", "dcf", "concise_dcf")


def _configuration(
    files: Mapping[str, Path | None], objects: Document, node_id: int, place: str
) -> tuple[ConciseEntry, ...]:
    """Return the writes that configure a slave: first those of a file, then single objects.

    Raises:
        ConfigError: two files, or objects of a device of which no EDS tells the types.
    """
    dcf, concise = files["dcf"], files["concise_dcf"]
    if dcf is not None and concise is not None:
        raise ConfigError("dcf and concise_dcf are both given; give one")
    entries: tuple[ConciseEntry, ...] = ()
    if dcf is not None:
        entries = convert_dcf(dcf, node_id)
    elif concise is not None:
        entries = read_concise_dcf(concise)
    if not objects:
        return entries
    described = files["eds"] or dcf
    if described is None:
        raise ConfigError("objects need the types of an EDS; give eds")
    return entries + _writes(described, objects, node_id, f"{place}.objects")


def _writes(eds: Path, objects: Document, node_id: int, place: str) -> tuple[ConciseEntry, ...]:
    """Return single objects as writes.

    Raises:
        ConfigError: an object is not there, cannot be written or cannot have its value.
    """
    dictionary = load_eds(eds, node_id)
    defaults = {
        (variable.index, variable.subindex): variable.default
        for variable in dictionary
        if isinstance(variable.default, int)
    }
    given = {parse_object(name): value for name, value in objects.items()}
    bound = next((name for name, value in objects.items() if isinstance(value, dict)), None)
    if bound is not None:
        raise ConfigError(f"{place}.{bound}: is a table; give a value")
    override_defaults(dictionary, given, place=place, node_id=node_id)  # type: ignore[arg-type]
    values = {}
    for key in given:
        variable = dictionary.variable(*key)
        if not variable.access.writable:
            raise ConfigError(f"{place}.{name_object(*key)}: is read-only; leave it out")
        values[key] = variable.data_type.encode(variable.value)
    return order_writes(values, defaults)


def _identity_of(eds: Path, node_id: int) -> tuple[int, tuple[int, int, int, int]]:
    """Return device type and identity by an EDS, 0 where it gives none."""
    dictionary = load_loosely(eds, node_id)

    def number(index: int, subindex: int) -> int:
        variable = dictionary.get_variable(index, subindex)
        value = None if variable is None or variable.subindex != subindex else variable.default
        return value if isinstance(value, int) else 0

    vendor, product, revision, serial = (number(0x1018, sub) for sub in (1, 2, 3, 4))
    return number(0x1000, 0), (vendor, product, revision, serial)


# The verb.

_EXAMPLES = """\
examples:
  hil-bench boot --virtual                                         the built-in bench
  hil-bench boot -i socketcan -c can0 bench.toml                   the devices of a bench
  hil-bench boot -i socketcan -c can0 --network examples/network.toml --stay inf
                                                                   a network, until Ctrl-C
  hil-bench boot --network examples/network.toml --concise-dcf .   write files, send nothing
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "boot",
        description="Boot a CANopen network as its NMT master (CiA 302-2): reset, check device\n"
        "type and identity of each slave, configure it, wait for its heartbeat, start it.",
        epilog=_EXAMPLES,
    )
    arguments.add_bench_arguments(parser)
    common.add_network_arguments(parser)
    parser.add_argument(
        "--network",
        type=Path,
        metavar="FILE",
        help="the network list (docs/commissioning.md); without it the nodes of the bench, each "
        "mandatory, checked by its EDS and not configured",
    )
    parser.add_argument(
        "--stay",
        type=_duration,
        default=0.0,
        metavar="S",
        help="stay for S seconds, or inf: send the master's heartbeat, boot anew what is lost or "
        "comes late",
    )
    parser.add_argument(
        "--concise-dcf",
        type=Path,
        metavar="DIR",
        help="boot nothing: write the configuration of each slave as concise DCF (0x1F22) into DIR",
    )
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Boot the network; exit code 0 if it was started and, with --stay, was up to the end.

    1 where a mandatory slave is missing or reports another state, 6 where one reports no state.
    """
    config = arguments.load_bench_config(args)
    plan = load_boot_plan(args.network) if args.network else None
    if args.concise_dcf is not None:
        return _write_concise(args, plan)
    if plan is None:
        plan = plan_of_bench(common.seen_from_bus(args, config))
    with open_network(args, config) as opened:
        if not is_silent(args):
            print_lines(args, f"bus      {opened.description}")
        is_started, manager = _boot(args, opened.network, plan)
    results = list(manager.results.values())
    verdict = _verdict(manager, is_started=is_started)
    content = {"started": is_started, "slaves": [_content(result, manager) for result in results]}
    print_results(args, [f"network  {verdict}"], content)
    if not is_started:
        return ExitCode.CHECK_FAILED
    return ExitCode.INCONCLUSIVE if manager.unseen else ExitCode.DONE


def _boot(
    args: argparse.Namespace, network: Network, plan: BootPlan
) -> tuple[bool, NetworkManager]:
    def tell(line: str) -> None:
        if not is_silent(args):
            print_lines(args, line)

    manager = NetworkManager(network, plan.slaves, plan.startup, tell)
    if plan.heartbeat:
        network.start_heartbeat(plan.node_id, plan.heartbeat)
    is_started = manager.boot()
    if is_started and args.stay:
        try:
            is_started = manager.watch(args.stay)
        except KeyboardInterrupt:
            if not math.isinf(args.stay):
                raise
            print("ended by Ctrl-C; the slaves stay as they are", file=sys.stderr)
    return is_started, manager


def _duration(text: str) -> float:
    """Return a time to stay.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not seconds > 0.0:
        raise argparse.ArgumentTypeError(f"{text!r}: give a positive number of seconds, or inf")
    return seconds


def _verdict(manager: NetworkManager, *, is_started: bool) -> str:
    results = list(manager.results.values())
    missing = [result for result in results if not result.is_up]
    names = ", ".join(
        f"{result.slave} ({result.error.name})"
        for result in missing
        if result.error is not None and (is_started or result.slave.mandatory)
    )
    if manager.left_out:
        there = ", ".join(f"{s} is {_state(manager, s)}" for s in manager.left_out)
        return f"not started: mandatory {there}"
    if not is_started:
        return f"not started: mandatory {names}" if names else "not started"
    more = f" without {names}" if names else f", {len(results)} slaves"
    if manager.startup.start is Start.NONE:
        return f"booted{more}; the application starts it"
    if manager.unseen:
        return f"start commanded{more}; no state from {', '.join(map(str, manager.unseen))}"
    return f"started{more}"


def _state(manager: NetworkManager, slave: Slave) -> str:
    state = manager.states.get(slave.node_id)
    return state.name.replace("_", "-") if state else "not reported"


def _content(result: BootResult, manager: NetworkManager) -> dict[str, object]:
    return {
        "node_id": result.slave.node_id,
        "name": result.slave.name,
        "mandatory": result.slave.mandatory,
        "booted": result.is_up,
        "error": result.error.name if result.error else None,
        "meaning": result.error.value if result.error else None,
        "reason": result.reason or None,
        "configuration": result.configured.value,
        "state": _state(manager, result.slave),
    }


def _write_concise(args: argparse.Namespace, plan: BootPlan | None) -> int:
    """Write the concise DCF of each slave that has a configuration.

    Raises:
        ConfigError: there is no network list.
    """
    if plan is None:
        raise ConfigError("--concise-dcf: needs the configurations of a network; give --network")
    directory: Path = args.concise_dcf
    with about_file(f"--concise-dcf {directory}"):
        directory.mkdir(parents=True, exist_ok=True)
        for slave in plan.slaves:
            if slave.configuration:
                path = directory / f"{slave.name}.cdcf"
                with whole_file(path) as file:
                    file.write_bytes(pack_concise_dcf(slave.configuration))
                print_lines(args, f"{path}: {len(slave.configuration)} entries")
    return ExitCode.DONE
