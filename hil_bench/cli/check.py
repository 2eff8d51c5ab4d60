"""`hil-bench check`: the resolved configuration, and with --bus whether the devices are so."""

import argparse
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path

from hil_bench.bench.configuration import AxisConfig, BenchConfig, Setting
from hil_bench.bench.configuration.nodes_section import find_in_eds
from hil_bench.bench.configuration.plausibility import find_doubts
from hil_bench.canopen_device.eds_document import EdsFinding, Severity
from hil_bench.cli.arguments import add_bench_arguments, load_bench_config
from hil_bench.cli.devices import read_devices
from hil_bench.cli.exit_codes import ExitCode, worst
from hil_bench.cli.parser import add_options, take_over
from hil_bench.cli.results import add_json_argument, json_text, warn_of
from hil_bench.config.settings import Origin
from hil_bench.plants.hydraulic_cylinder.supply_group import Fed, SupplyConfig, summarise_supply
from hil_bench.plants.plant import Fact

# The key figures of an axis, as lines.


def facts_of(config: BenchConfig, axis: AxisConfig) -> Sequence[Fact]:
    """Return the key figures of an axis."""
    return axis.kind.summarise(axis, config.tick_ns // 1000, config.step_ns // 1000)


def facts_of_supply(config: BenchConfig, supply: SupplyConfig) -> Sequence[Fact]:
    """Return the key figures of a supply that axes share."""
    axes = [axis for axis in config.axes if axis.name in supply.axes and isinstance(axis, Fed)]
    return list(summarise_supply(supply, axes, config.dt))


def summary_lines(config: BenchConfig, axis: AxisConfig) -> list[str]:
    """Return the key figures of an axis as lines."""
    return fact_lines(facts_of(config, axis))


def fact_lines(facts: Sequence[Fact]) -> list[str]:
    """Return facts as lines: name, value with its unit, note."""
    width = max((len(fact.name) for fact in facts), default=0)
    return [
        f"{fact.name:{width}}  {_short(fact.value):>8} {fact.unit:6}  {fact.note}".rstrip()
        for fact in facts
    ]


def _short(value: float) -> str:
    """Return a number with four digits that count, and no exponent."""
    return f"{float(f'{value:.4g}'):.10g}"


_EXAMPLES = """\
examples:
  hil-bench check                       the built-in bench
  hil-bench check bench.toml
  hil-bench check bench.toml -i socketcan -c can0
  hil-bench check > bench.toml          a file with every key, to begin with
  hil-bench check bench.toml --json
  hil-bench check bench.toml --bus -i socketcan -c can0           compare the devices with it
  hil-bench check bench.toml --bus -i socketcan -c can0 --apply   and write what differs
"""

_COMMENT_COLUMN = 56
_BUS_TABLES = ("bus", "buses.")


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "check",
        description="Check a bench and its EDS files, and print each value with its origin\n"
        "(default, data sheet, file, environment, command line) as a bench.toml, then what an\n"
        "engineer checks first of each axis: speeds, forces, frequencies. No bus is opened\n"
        "except with --bus, which compares the devices on it with the bench, one line per\n"
        "difference. Exit code 1 where an EDS file has an error, with --bus also where a\n"
        "difference remains; warnings leave it 0.",
        epilog=_EXAMPLES,
    )
    add_bench_arguments(parser)
    add_json_argument(parser)
    add_options("check", parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Check everything that can be checked without a bus, then print it or compare the bus."""
    config = load_bench_config(args)
    read_devices(config)
    if any(part.is_fitted for part in config.parts):
        from hil_bench.bench.assembly import build_bench  # noqa: PLC0415 - a whole bench, for these

        build_bench(config)  # refuses parts that do not fit the devices
    findings = find_in_eds((node.eds, node.node_id) for node in config.nodes)
    all_work = all(
        each.severity is not Severity.ERROR for some in findings.values() for each in some
    )
    code = ExitCode.DONE if all_work else ExitCode.CHECK_FAILED
    compared = take_over("check", args, config)
    if compared is not None:
        return worst(ExitCode(compared), code)
    doubts = find_doubts(config)
    if args.json:
        print(_json_text(config, doubts, findings))
    elif not args.quiet:
        print("\n".join(_toml_lines(config)))
    warn_of(doubts)
    return code


def _toml_lines(config: BenchConfig) -> Iterator[str]:
    """Yield TOML that loads again, each value with its origin as a comment, then the summary."""
    yield f"# {config.path or 'built-in bench'}"
    for table, settings in groupby(config.settings, key=lambda setting: setting.table):
        yield ""
        listed = re.fullmatch(r"(\w+)\[\d+\]", table)
        yield f"[[{listed[1]}]]" if listed else f"[{table}]"
        yield from map(_line, settings)
    for axis in config.axes:
        if lines := summary_lines(config, axis):
            yield from ("", f"# What {axis.name} can do:", *(f"#   {line}" for line in lines))
    for supply in config.supplies:
        facts = fact_lines(facts_of_supply(config, supply))
        yield from ("", f"# What {supply.name} can give:", *(f"#   {line}" for line in facts))


def _line(setting: Setting) -> str:
    name = setting.key.name
    if setting.value is None:
        is_bus = setting.table.startswith(_BUS_TABLES) and name != "data_bitrate"
        why = "left to python-can" if is_bus else "none"
        return f"{f'# {name} =':{_COMMENT_COLUMN}}  # {why}"
    if setting.origin is Origin.DATA_SHEET:  # once more as a value it would be given twice
        value = _toml_value(setting.value)
        if isinstance(setting.value, float):
            value = f"{setting.value:.6g}"
        return f"{f'# {name} = {value}':{_COMMENT_COLUMN}}  # {setting.reason}"
    assignment = f"{name} = {_toml_value(setting.value)}"
    return f"{assignment:{_COMMENT_COLUMN}}  # {setting.origin}"


def _toml_value(value: object) -> str:
    if isinstance(value, dict):
        pairs = (f"{json.dumps(key)} = {_toml_value(given)}" for key, given in value.items())
        return f"{{ {', '.join(pairs)} }}"
    return json.dumps(value, ensure_ascii=False)


def _json_text(
    config: BenchConfig, doubts: Sequence[str], findings: Mapping[Path, Sequence[EdsFinding]]
) -> str:
    settings = [
        {
            "table": setting.table,
            "key": setting.key.name,
            "value": setting.value,
            "unit": setting.key.unit.symbol,
            "origin": setting.origin,
            **({"reason": setting.reason} if setting.reason else {}),
        }
        for setting in config.settings
    ]
    path = str(config.path) if config.path else None
    summary = {
        axis.name: [fact._asdict() for fact in facts_of(config, axis)] for axis in config.axes
    }
    summary |= {
        supply.name: [fact._asdict() for fact in facts_of_supply(config, supply)]
        for supply in config.supplies
    }
    content = {
        "path": path,
        "settings": settings,
        "summary": summary,
        "warnings": list(doubts),
        "eds": {str(path): list(some) for path, some in findings.items()},
    }
    return json_text(content)
