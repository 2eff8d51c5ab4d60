"""`hil-bench new`: a bench.toml from the data sheets of an axis."""

import argparse
import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from hil_bench.abilities.common.files import whole_file
from hil_bench.abilities.new import wording
from hil_bench.bench.configuration import load_config
from hil_bench.bench.configuration.plausibility import find_doubts
from hil_bench.cli.check import facts_of, summary_lines
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import add_json_argument, print_lines, print_results, warn_of
from hil_bench.errors import (
    ConfigError,
    about_file,
)
from hil_bench.plants.hydraulic_cylinder.data_sheet.oil import OILS

_EXAMPLES = f"""\
examples:
  hil-bench new                         asks, and writes bench.toml
  hil-bench new press.toml --cylinder {wording.CYLINDER_EXAMPLE} --valve "60 l/min @ 5 bar" \\
      --supply 210 --load 500
  hil-bench new --cylinder 80/45/45x300 --valve "servo NG10" --supply 210 --load 250
  hil-bench new --catalogue             bores, rods and valve sizes
"""

_SPANS = (60.0, 100.0, 160.0, 250.0, 400.0, 600.0, 1000.0, 1600.0)
"""Measuring ranges of pressure transducers [bar]."""

_COMMENT_COLUMN = 40
_NO_PUMP = "none"
_OPTION = "command line"
_ANSWER = "answer"

_NODES = """
[nodes.valve]
profile = "valve_408"
node_id = 1

[nodes.pressure_a]
profile = "pressure_404"
node_id = 2
source = "P_A"
span_bar = [0, {span:g}]

[nodes.pressure_b]
profile = "pressure_404"
node_id = 3
source = "P_B"
span_bar = [0, {span:g}]

[nodes.position]
profile = "encoder_406"
node_id = 4
"""

Read = Callable[[str, str], list[wording.Datum]]


class _Question(NamedTuple):
    """A question about an axis.

    Attributes:
        option: of the command line, without its dashes.
        text: of the question.
        default: of the answer; empty where one must be given.
        read: makes data of the answer and its origin.
    """

    option: str
    text: str
    default: str
    read: Read


def _read_number(key: str, unit: str, low: float, high: float) -> Read:
    def read(text: str, origin: str) -> list[wording.Datum]:
        try:
            value = float(text.removesuffix(unit).strip())
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise ConfigError(
                f'"{text}" is out of range; give a number in {unit}, {low:g} to {high:g}'
            )
        return [wording.Datum(key, value, origin)]

    return read


def _read_oil(text: str, origin: str) -> list[wording.Datum]:
    if text not in OILS:
        known = ", ".join(f'"{name}"' for name in OILS)
        raise ConfigError(f'"{text}" is unknown; give one of {known}')
    return [wording.Datum("oil", text, origin)]


def _read_pump(text: str, origin: str) -> list[wording.Datum]:
    if text == _NO_PUMP:
        return []
    flow = _read_number("pump_flow_l_min", "l/min", 0.05, 1e5)
    return [wording.Datum("supply", "unit", origin), *flow(text, origin)]


_QUESTIONS = (
    _Question(
        "cylinder",
        f"cylinder, BORE/RODxSTROKE in mm, such as {wording.CYLINDER_EXAMPLE}",
        "",
        wording.read_cylinder,
    ),
    _Question(
        "valve", f'valve, such as "{wording.VALVE_EXAMPLE}", or NG10', "", wording.read_valve
    ),
    _Question(
        "supply",
        "supply pressure in bar",
        "",
        _read_number("supply_pressure_bar", "bar", 1.0, 1000.0),
    ),
    _Question(
        "pump",
        f"flow of the pump in l/min, {_NO_PUMP} where the supply holds its pressure",
        _NO_PUMP,
        _read_pump,
    ),
    _Question(
        "load",
        "mass that moves with the rod in kg",
        "",
        _read_number("load_mass_kg", "kg", 0.0, 1e6),
    ),
    _Question(
        "slope",
        "slope of the axis in degrees, 90 for one that lifts",
        "0",
        _read_number("load_slope_deg", "deg", -90.0, 90.0),
    ),
    _Question("oil", "oil", "HLP 46", _read_oil),
)


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "new",
        description="Write a bench.toml from the data sheets of an axis, each value with where it\n"
        "comes from, and print what an engineer checks first: speeds, forces, frequencies.\n"
        "On a terminal it asks for what no option gives.",
        epilog=_EXAMPLES,
    )
    parser.add_argument(
        "file",
        nargs="?",
        type=Path,
        default=Path("bench.toml"),
        help="file to write (default: bench.toml)",
    )
    parser.add_argument(
        "--cylinder",
        metavar="BORE/RODxSTROKE",
        help="in mm, as in 63/36x500; BORE/ROD/RODxSTROKE for a double rod",
    )
    parser.add_argument(
        "--valve",
        metavar="VALVE",
        help=f'"{wording.VALVE_EXAMPLE}" per edge, or a size, as in NG10'.replace("%", "%%"),
    )
    parser.add_argument("--supply", metavar="BAR", help="supply pressure in bar, as in 210")
    parser.add_argument(
        "--pump",
        metavar="L_MIN",
        help=f"flow of the pump in l/min, as in 40 (default: {_NO_PUMP}, a constant supply)",
    )
    parser.add_argument(
        "--load", metavar="KG", help="mass that moves with the rod in kg, as in 500"
    )
    parser.add_argument(
        "--slope",
        metavar="DEG",
        help="slope of the axis in degrees; 90 lifts the load (default: 0)",
    )
    parser.add_argument("--oil", metavar="OIL", help=f"{', '.join(OILS)} (default: HLP 46)")
    parser.add_argument("--force", action="store_true", help="overwrite an existing file")
    parser.add_argument(
        "--catalogue",
        action="store_true",
        help="print standard sizes of cylinders and valves, and exit",
    )
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write a bench.toml and print its summary.

    Raises:
        ConfigError: the file is there already, a datum makes no sense, or it cannot be written.
    """
    if args.catalogue:
        print_lines(args, *wording.catalogue_lines())
        return ExitCode.DONE
    if args.file.exists() and not args.force:
        raise ConfigError(f"{args.file}: is there already; give another name, or --force")
    data = collect_data(vars(args), ask=_ask if sys.stdin.isatty() else None)
    text = bench_text(data)
    right = "give a file in a directory of yours"
    with about_file(args.file, right=right), whole_file(args.file, replaces=True) as file:
        file.write_text(text, encoding="utf-8")
        try:
            load_config(file)  # what makes no sense leaves no file
        except ConfigError as error:
            raise ConfigError(str(error).replace(str(file), str(args.file))) from None
    config = load_config(args.file)
    (axis,) = config.axes
    doubts = find_doubts(config)
    facts = [fact._asdict() for fact in facts_of(config, axis)]
    content = {"path": str(args.file), "summary": {axis.name: facts}, "warnings": doubts}
    print_results(args, (f"wrote {args.file}", "", *summary_lines(config, axis)), content)
    warn_of(doubts)
    return ExitCode.DONE


def collect_data(
    options: Mapping[str, str | None], *, ask: Callable[[str], str] | None
) -> list[wording.Datum]:
    """Return the data of an axis, from options where they say it.

    Args:
        options: by name, None for what is not given.
        ask: returns the answer to a question; None where nobody is there to answer.

    Raises:
        ConfigError: what is missing or wrong, a line each.
    """
    data: list[wording.Datum] = []
    problems: list[str] = []
    for question in _QUESTIONS:
        given = options.get(question.option)
        if given is None and ask is not None:
            data += _answer(question, ask)  # the end of the input is the end of all questions
            continue
        try:
            if given is not None:
                data += question.read(given, _OPTION)
            elif question.default:
                data += question.read(question.default, "assumed")
            else:
                problems.append(f"--{question.option}: missing; give the {question.text}")
        except ConfigError as error:
            problems.append(f"--{question.option}: {error}")
    if problems:
        raise ConfigError("\n".join(problems))
    return [*data, *_relief_of(data)]


def _relief_of(data: Sequence[wording.Datum]) -> Iterator[wording.Datum]:
    """Yield the setting of the relief valve of a pump: the supply's pressure."""
    by_key = {datum.key: datum for datum in data}
    if "pump_flow_l_min" in by_key:
        yield by_key["supply_pressure_bar"]._replace(key="relief_pressure_bar")


def bench_text(data: Sequence[wording.Datum]) -> str:
    """Return the text of a bench.toml."""
    lines = ["[plant.axis1]"]
    for datum in data:
        assignment = f"{datum.key} = {json.dumps(datum.value)}"
        lines.append(f"{assignment:{_COMMENT_COLUMN}}  # {datum.origin}")
    return "\n".join(lines) + "\n" + _NODES.format(span=_span(data))


def _span(data: Sequence[wording.Datum]) -> float:
    """Return the measuring range for the pressure that a single rod makes in its chamber [bar]."""
    values = {datum.key: datum.value for datum in data if isinstance(datum.value, float)}
    bore, rod = values["bore_mm"], values["rod_mm"]
    ratio = max(1.0, (bore**2 - values.get("second_rod_mm", 0.0) ** 2) / (bore**2 - rod**2))
    highest = values["supply_pressure_bar"] * ratio
    return next((span for span in _SPANS if span >= highest), _SPANS[-1])


def _answer(question: _Question, ask: Callable[[str], str]) -> list[wording.Datum]:
    """Ask the user until the answer is valid; return its data."""
    default = f" [{question.default}]" if question.default else ""
    while True:
        text = ask(f"{question.text}{default}: ").strip() or question.default
        try:
            return question.read(text, _ANSWER)
        except ConfigError as error:
            print(error, file=sys.stderr)


def _ask(text: str) -> str:
    """Return a line from the terminal; the question goes to standard error.

    Raises:
        ConfigError: the input has ended.
    """
    print(text, end="", file=sys.stderr, flush=True)
    line = sys.stdin.readline()
    if not line:
        print(file=sys.stderr)
        raise ConfigError("the input has ended; nothing was written")
    return line
