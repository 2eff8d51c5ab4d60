"""`hil-bench ctl`: a running bench from the shell: state, objects, loads, and others'."""

import argparse
import contextlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from hil_bench.abilities.common.shown_units import add_units_argument, shown_unit
from hil_bench.abilities.common.terminal import (
    health_text,
    node_text,
)
from hil_bench.abilities.live.client import FeedClient, connect
from hil_bench.abilities.live.places import HAS_SOCKETS, find_names, where_looked
from hil_bench.ability import given_to
from hil_bench.cli.arguments import parse_value
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.parser import Parser
from hil_bench.cli.results import (
    add_json_argument,
    ecu_text,
    print_results,
)
from hil_bench.config.values import quote
from hil_bench.errors import (
    BusError,
    ConfigError,
    ControllerError,
    HilBenchError,
    WaitTimeoutError,
    printable,
)
from hil_bench.units import BAR, MEGAPASCAL, NEWTON, NEWTON_METRE, PASCAL, Unit

_EXAMPLES = """\
examples:
  hil-bench ctl list
  hil-bench ctl status --json
  hil-bench ctl --bench bench-2 status
  hil-bench ctl set axis1.load_n=5000 axis1.supply_pressure_bar=80
  hil-bench ctl set valve.0x1017=500
  hil-bench ctl get valve.0x1017 --bench bench-2
  hil-bench ctl mark "the wire was pulled here"
  hil-bench ctl stop
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "ctl",
        description="Read, set and break a bench that hil-bench run runs on this machine.",
        epilog=_EXAMPLES,
    )
    add_bench_argument(parser)
    add_json_argument(parser)
    add_units_argument(parser)
    actions = parser.add_subparsers(
        title="actions", metavar="ACTION", required=True, parser_class=Parser
    )
    listing = actions.add_parser("list", help="list the running benches")
    add_json_argument(listing, default=argparse.SUPPRESS)
    listing.set_defaults(run=list_benches)
    _add(actions, "status", show_status, "show states, faults, values and how the loop is")
    for module in given_to("ctl"):
        module.add_actions(partial(_add, actions))
        parser.epilog = f"{parser.epilog}{getattr(module, 'EXAMPLES', '')}"
    setting = _add(
        actions, "set", set_values, "set objects of nodes, signals of J1939 devices, and loads"
    )
    setting.add_argument(
        "settings",
        nargs="+",
        metavar="PLACE=VALUE",
        help="as in axis1.load_n=5000, valve.0x1017=500 or joystick.x=50; bytes as in hex:00ff",
    )
    marking = _add(actions, "mark", mark, "mark this moment for all who watch")
    marking.add_argument("text", help="text of the mark")
    _add(actions, "stop", stop, "end the run in order, as --duration does")
    getting = _add(
        actions, "get", get_values, "read objects of nodes, and signals of J1939 devices"
    )
    getting.add_argument(
        "objects",
        nargs="+",
        metavar="NODE.OBJECT",
        help="object or signal to read, as in valve.0x1017 or joystick.x",
    )


def add_bench_argument(parser: argparse.ArgumentParser, *, default: str | None = None) -> None:
    """Add --bench; `argparse.SUPPRESS` as its default leaves what an outer parser set."""
    parser.add_argument(
        "--bench",
        default=default,
        metavar="NAME",
        help="name of the bench, if more than one runs (hil-bench ctl list)",
    )


@contextlib.contextmanager
def bench_errors() -> Iterator[None]:
    """Let a bench that does not answer, or cannot act, count as one that is lost.

    Yields:
        Nothing.

    Raises:
        BusError: it is so.
    """
    try:
        yield
    except (ControllerError, WaitTimeoutError) as error:
        raise BusError(str(error)) from error


def list_benches(args: argparse.Namespace) -> int:
    """Print the benches that run."""
    found: list[dict[str, Any]] = []
    for name in find_names() if HAS_SOCKETS else ():
        try:
            with connect(name) as client:
                found.append({key: client.hello.get(key) for key in ("name", "pid", "bench")})
        except HilBenchError as error:
            found.append({"name": name, "error": str(error)})
    place = f" ({where_looked()})" if HAS_SOCKETS else ""
    lines = [_bench_line(bench) for bench in found] or [f"no bench runs{place}"]
    print_results(args, lines, {"benches": found})
    return ExitCode.DONE


def show_status(client: FeedClient, args: argparse.Namespace) -> None:
    """Print how the bench is."""
    status = client.request("status")
    print_results(args, status_lines(client.hello, status), {"name": client.name, **status})


def set_values(client: FeedClient, args: argparse.Namespace) -> None:
    """Set objects and loads; nothing is set where a word is wrong.

    What the bench refuses ends it: the settings before it have acted, and are printed.
    """
    from hil_bench.abilities.live.ctl import read_setting  # noqa: PLC0415 - and nobody else

    settings = [read_setting(word, client.hello) for word in args.settings]
    done: list[dict[str, Any]] = []
    try:
        for setting in settings:
            client.request(setting.action, **setting.fields)
            done.append(setting.fields)
    finally:
        print_results(args, args.settings[: len(done)], {"set": done})


def mark(client: FeedClient, args: argparse.Namespace) -> None:
    """Mark this moment."""
    client.request("mark", text=args.text)
    print_results(args, [printable(f"marked: {args.text}")], {"mark": args.text})


def stop(client: FeedClient, args: argparse.Namespace) -> None:
    """End the run."""
    client.request("stop")
    print_results(args, ["the bench ends"], {"stopped": client.name})


def get_values(client: FeedClient, args: argparse.Namespace) -> None:
    """Print what objects hold."""
    values = {}
    for word in args.objects:
        node, _, name = word.partition(".")
        values[word] = client.request("get_object", node=node, name=name)
    lines = [
        printable(
            f"{word} = {_object_text(value)} {_unit_text(word, value, client.hello)}".rstrip()
        )
        for word, value in values.items()
    ]
    print_results(args, lines, {"values": values})


def status_lines(hello: Mapping[str, Any], status: Mapping[str, Any]) -> Iterator[str]:
    """Yield how a bench is, for people.

    Yields:
        A line each.
    """
    state, values = status["state"], status["values"] or {}
    yield f"{_bench_line(hello)}, at {values.get('time', state['time']):.3f} s"
    ecus = state.get("ecus", {})
    channels = (name for name, _ in hello["channels"])
    width = max(map(len, [*state["nodes"], *ecus, *channels]), default=0)
    for name, node in state["nodes"].items():
        yield f"node   {name:{width}}  {node_text(node)}"
    for name, ecu in ecus.items():
        yield f"J1939  {name:{width}}  {ecu_text(ecu)}"
    for name, unit in hello["channels"]:
        shown = shown_unit(unit)
        yield f"value  {name:{width}}  {shown.text(values.get(name)):>10} {shown.symbol}"
    if work := state.get("work"):
        yield from map(printable, _work_lines(work))
    is_bench = has_bench(hello)
    for module in given_to("ctl"):
        yield from module.state_lines(state) or filter(None, [module.NOTHING] * is_bench)
    if health := health_text(status["health"]):  # work without a bench has no loop
        yield f"loop   {health}"


def progress_text(work: Mapping[str, Any]) -> str:
    """Return the progress of work, with the unit of what it counts; empty where nobody knows it."""
    unit = f" {work.get('unit', '')}".rstrip()
    return f"{work['done']:g} of {work['total']:g}{unit}  " if work["total"] else ""


def _work_lines(work: Mapping[str, Any]) -> Iterator[str]:
    """Yield how work goes; when it is over, its findings with the reason of each."""
    yield f"work   {progress_text(work)}{work['now'] or work['verdict']}".rstrip()
    for item in () if work["now"] else work["items"]:
        if item["text"] and item["verdict"] not in {"", "done"}:
            yield f"       {item['name']} {item['verdict']}: {item['text']}"


def _add(
    actions: "argparse._SubParsersAction[Parser]",
    name: str,
    act: Callable[[FeedClient, argparse.Namespace], None],
    what: str,
) -> argparse.ArgumentParser:
    def run(args: argparse.Namespace) -> int:
        with bench_errors(), connect(args.bench) as client:
            act(client, args)
        return ExitCode.DONE

    parser = actions.add_parser(name, help=what, description=f"{what[0].upper()}{what[1:]}.")
    add_bench_argument(parser, default=argparse.SUPPRESS)
    add_json_argument(parser, default=argparse.SUPPRESS)
    parser.set_defaults(run=run)
    return parser


def has_bench(hello: Mapping[str, Any]) -> bool:
    """Return True if a bench runs, and no work without one, such as a campaign."""
    return bool(hello.get("work", {"is_bench": True}).get("is_bench"))


def _bench_line(bench: Mapping[str, Any]) -> str:
    if "error" in bench:
        return printable(f"bench  {bench['name']}  {bench['error']}")
    return printable(f"bench  {bench['name']}  process {bench['pid']}, {bench['bench']}")


def _unit_text(word: str, value: object, hello: Mapping[str, Any]) -> str:
    """Return the unit of a J1939 signal; of an object's number, that it is as the bus has it."""
    place, _, name = word.partition(".")
    if place in (ecus := hello.get("ecus", {})):
        unit = ecus[place]["signals"].get(name, {}).get("unit", "")
        return "" if unit == "-" else str(unit)
    return "(raw)" if type(value) in {int, float} else ""


def _object_text(value: object) -> str:
    return f"hex:{value['hex']}" if isinstance(value, dict) else str(value)


# The words of `hil-bench ctl` as requests: settings with their units.

_UNITS: Mapping[str, Sequence[Unit]] = {
    "N": (NEWTON,),
    "N m": (NEWTON_METRE,),
    "Pa": (BAR, PASCAL, MEGAPASCAL),
}
"""In which what acts on a plant is given, by its SI unit."""

_RIGHT_SET = "give AXIS.QUANTITY_UNIT=NUMBER or NODE.OBJECT=VALUE"


class LiveSetting(NamedTuple):
    """The setting that a user asks for.

    Attributes:
        action: the request: "set_plant" or "set_object".
        fields: its fields.
    """

    action: str
    fields: dict[str, Any]


def read_setting(word: str, hello: Mapping[str, Any]) -> LiveSetting:
    """Return the request for ``axis1.load_n=5000``, ``io.0x6401.01=1234`` or ``joystick.x=50``.

    Raises:
        ConfigError: it is wrong.
    """
    path, sign, text = word.partition("=")
    place, dot, name = path.partition(".")
    if not (sign and dot and name):
        raise ConfigError(f"set {word}: {_RIGHT_SET}")
    if place in hello["axes"]:
        influence, unit = _influence(place, name, hello["axes"][place])
        value = parse_value(text)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            wrong = f"{quote(text)} is not a number" if text else "the value is missing"
            raise ConfigError(f"set {word}: {wrong}; {_RIGHT_SET}")
        _check_finite(word, value)
        low, high = (unit.from_si(influence[end]) for end in ("low", "high"))
        if not low <= value <= high:
            raise ConfigError(f"set {word}: give {low:g} to {high:g} {unit.symbol}")
        fields = {"axis": place, "quantity": influence["name"], "value": unit.to_si(value)}
        return LiveSetting("set_plant", fields)
    if place in {*hello["nodes"], *hello.get("ecus", {})}:
        held = _object_value(text)
        _check_finite(word, held)
        return LiveSetting("set_object", {"node": place, "name": name, "value": held})
    known = ", ".join([*hello["axes"], *hello["nodes"], *hello.get("ecus", {})])
    raise ConfigError(f'set {word}: there is no axis or node "{place}"; give one of {known}')


def _influence(
    axis: str, name: str, influences: Sequence[Mapping[str, Any]]
) -> tuple[Mapping[str, Any], Unit]:
    known = {}
    for influence in influences:
        for unit in _UNITS.get(influence["unit"], (Unit(influence["unit"], ""),)):
            known[influence["name"] + unit.suffix] = (influence, unit)
    if name not in known:
        right = f"give {', '.join(known)}" if known else "nothing of its plant can be set"
        raise ConfigError(f"set {axis}.{name}: cannot be set; {right}")
    return known[name]


def _check_finite(word: str, value: object) -> None:
    """Refuse a number that is none.

    Raises:
        ConfigError: it is.
    """
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"set {word}: {value:g} is not finite; give a number")


def _object_value(text: str) -> object:
    """Return a value for an object; bytes are ``hex:00ff``.

    Raises:
        ConfigError: it is none.
    """
    if text.startswith("hex:"):
        try:
            return {"hex": bytes.fromhex(text[4:]).hex()}
        except ValueError:
            raise ConfigError(f"set: {text}: give an even number of hexadecimal digits") from None
    value = parse_value(text)
    return value if isinstance(value, (str, bool, int, float)) else text
