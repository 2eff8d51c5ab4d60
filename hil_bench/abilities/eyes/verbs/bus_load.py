"""`hil-bench bus-load`: will it fit? Load and worst-case response times of a bench's buses."""

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from hil_bench.abilities.eyes import traffic
from hil_bench.abilities.eyes.known_node import nodes_of
from hil_bench.abilities.j1939.configuration.dbc_file import load_dbc
from hil_bench.ability import given_to
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.configuration.records import FIRST_BUS
from hil_bench.canopen_device.frame import Frame
from hil_bench.cli.arguments import add_bench_arguments, load_bench_config
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import add_json_argument, print_results
from hil_bench.errors import ConfigError
from hil_bench.outside.bits import USUAL_BITRATE, bitrate_text

_NS_PER_S = 1_000_000_000
_NS_PER_MS = 1_000_000
_NS_PER_US = 1_000

_EXAMPLES = """\
examples:
  hil-bench bus-load bench.toml
  hil-bench bus-load bench.toml -b 125000 --cycle-ms 10 --max-load 60
  hil-bench bus-load bench.toml --simulate 0 --json
  hil-bench bus-load bench.toml --dbc vendor.dbc           beside messages of others

Response times by Davis, Burns, Bril and Lukkien (2007), with the most stuff bits, and an SDO frame
that may be on the bus already; on a bus of CAN FD one of 64 bytes with BRS. Deadline of a frame is
its next one.

exit code 1 where the load is above --max-load, or a frame may come later than its next one
"""


@dataclass(frozen=True, slots=True)
class _Row:
    """One message on one bus; times in seconds, None where there is no bound or no frame."""

    bus: str
    name: str
    can_id: int
    length: int
    is_fd: bool
    period: float
    why: str
    response: float | None
    simulated: float | None
    frames: int
    fits: bool


@dataclass(frozen=True, slots=True)
class _Bus:
    """One bus; loads as a share of its time."""

    name: str
    bitrate: int
    data_bitrate: int | None
    load: float
    simulated_load: float | None
    fits: bool


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "bus-load",
        description="Compute the load of a bench's buses and the longest time that each PDO,\n"
        "SYNC and heartbeat may take, beside what a simulation shows.",
        epilog=_EXAMPLES,
    )
    add_bench_arguments(parser)
    parser.add_argument(
        "--cycle-ms",
        type=float,
        default=10.0,
        metavar="MS",
        help="cycle of the controller's SYNC and RPDOs, and of a TPDO without inhibit time and "
        "event timer, in ms (default: 10)",
    )
    parser.add_argument(
        "--jitter-us",
        type=float,
        default=0.0,
        metavar="US",
        help="how late a device or the controller may queue a frame, in us (default: 0)",
    )
    parser.add_argument(
        "--max-load",
        type=float,
        default=80.0,
        metavar="%",
        help="highest load allowed, in percent (default: 80)",
    )
    parser.add_argument(
        "--dbc",
        type=Path,
        metavar="FILE.dbc",
        help="further messages of the first bus: those of a DBC file with a cycle time, also of "
        "CAN FD (pip install 'hil-bench[dbc]')",
    )
    parser.add_argument(
        "--simulate",
        type=float,
        default=60.0,
        metavar="S",
        help="simulate S seconds of bench time (default: 60); 0 for not at all",
    )
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Compute, simulate and compare."""
    _check_arguments(args)
    config = load_bench_config(args)
    buses, rows = [], []
    for name in config.buses:
        bus, of_bus = _judge(args, config, name)
        buses.append(bus)
        rows += of_bus
    content = {"buses": buses, "messages": rows}
    print_results(args, _lines(buses, rows), content)
    is_right = all(bus.fits for bus in buses) and all(row.fits for row in rows)
    return ExitCode.DONE if is_right else ExitCode.CHECK_FAILED


def _check_arguments(args: argparse.Namespace) -> None:
    """Refuse numbers that make no sense.

    Raises:
        ConfigError: it says which, and what would be right.
    """
    bounds: Mapping[str, tuple[float, float]] = {
        "cycle_ms": (0.1, 10_000.0),
        "jitter_us": (0.0, 1e6),
        "max_load": (1.0, 100.0),
        "simulate": (0.0, 3600.0),
    }
    for name, (low, high) in bounds.items():
        value = getattr(args, name)
        if not low <= value <= high:
            flag = name.replace("_", "-")
            raise ConfigError(f"--{flag} {value:g}: give {low:g} to {high:g}")


def _judge(args: argparse.Namespace, config: BenchConfig, name: str) -> tuple[_Bus, list[_Row]]:
    """Compute the load of one bus and its streams.

    Raises:
        ConfigError: nothing cyclic is on it.
    """
    bus = config.buses[name]
    bitrate = bus.bitrate or USUAL_BITRATE
    given = traffic.Assumptions(
        bitrate,
        round(args.cycle_ms * _NS_PER_MS),
        round(args.jitter_us * _NS_PER_US),
        (bus.data_bitrate or bitrate) if bus.fd else 0,
    )
    streams = traffic.find_streams(nodes_of(config.seen_from(name)), given)
    others = _others(args, streams, given) if name == FIRST_BUS else []
    streams = sorted([*streams, *others], key=lambda stream: stream.message.priority)
    if not streams:
        raise ConfigError(f"{config.path or 'bench'}: no node of {name} has a PDO or a heartbeat")
    messages = [stream.message for stream in streams]
    bit_time = _NS_PER_S // bitrate
    bounds = traffic.response_times(
        messages, bit_time=bit_time, blocking=traffic.longest_foreign(given)
    )
    load = traffic.utilisation(messages)
    found, simulated = None, None
    if args.simulate:
        duration = round(args.simulate * _NS_PER_S)
        commands = list(_commands(streams))
        found = _simulation()(
            config,
            name,
            commands,
            cycle=given.cycle,
            bitrate=bitrate,
            duration=duration,
            others=[(stream.frame, stream.message.period) for stream in others],
        )
        simulated = found.busy / duration
    rows = [_row(name, stream, bounds[stream.message.name], found) for stream in streams]
    fits = load <= args.max_load / 100.0
    return _Bus(name, bitrate, given.data_bitrate or None, load, simulated, fits), rows


def _simulation() -> Callable[..., traffic.MeasuredTraffic]:
    """Return the `measure_traffic` of the ability that simulates a bus with its wire.

    Raises:
        ConfigError: there is none.
    """
    for module in given_to("eyes"):
        found: Callable[..., traffic.MeasuredTraffic] = module.measure_traffic
        return found
    raise ConfigError("--simulate: nothing here simulates a bus; give --simulate 0")


def _others(
    args: argparse.Namespace, streams: Sequence[traffic.Stream], given: traffic.Assumptions
) -> list[traffic.Stream]:
    """Return the messages of a DBC that are of no node of the bench."""
    if args.dbc is None:
        return []
    known = {stream.frame.can_id for stream in streams}
    found = traffic.dbc_streams(load_dbc(args.dbc).messages, given)
    return [each for each in found if each.frame.is_extended or each.frame.can_id not in known]


def _commands(streams: Sequence[traffic.Stream]) -> Iterator[Frame]:
    """Yield what the controller sends in each cycle."""
    return (stream.frame for stream in streams if stream.why == "cycle")


def _row(
    bus: str, stream: traffic.Stream, bound: int | None, found: traffic.MeasuredTraffic | None
) -> _Row:
    frame = stream.frame
    worst = None if found is None else found.worst.get(frame.can_id)
    return _Row(
        bus,
        stream.message.name,
        frame.can_id,
        len(frame.data),
        frame.fd != 0,
        stream.message.period / _NS_PER_S,
        stream.why,
        None if bound is None else bound / _NS_PER_S,
        None if worst is None else worst / _NS_PER_S,
        0 if found is None else found.counts.get(frame.can_id, 0),
        bound is not None and bound <= stream.message.period,
    )


def _lines(buses: Sequence[_Bus], rows: Sequence[_Row]) -> Iterator[str]:
    for bus in buses:
        name = f"{bus.name}: " if len(buses) > 1 else ""
        simulated = "" if bus.simulated_load is None else f", simulated {bus.simulated_load:.1%}"
        verdict = "" if bus.fits else "  TOO MUCH"
        rate = bitrate_text(bus.bitrate)
        if bus.data_bitrate:
            rate += f", data at {bitrate_text(bus.data_bitrate)}"
        yield f"{name}load {bus.load:.1%} of {rate}{simulated}{verdict}"
        yield ""
        yield (
            f"{'id':5}  {'message':24} {'bytes':>5} {'period':>10}  {'by':12} "
            f"{'longest':>10} {'simulated':>10}"
        )
        for row in rows:
            if row.bus == bus.name:
                yield _line(row)


def _line(row: _Row) -> str:
    verdict = "" if row.fits else "  LATE"
    return (
        f"0x{row.can_id:03X}  {row.name:24} {row.length:5} {_time(row.period):>10}  {row.why:12} "
        f"{_time(row.response):>10} {_time(row.simulated):>10}{verdict}"
    )


def _time(time: float | None) -> str:
    return "-" if time is None else f"{time * 1e3:.3f} ms"
