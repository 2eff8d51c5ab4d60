"""`hil-bench registers`: what stands where on Modbus, without opening a port."""

import argparse
import csv
import sys
from collections.abc import Iterator, Sequence

from hil_bench.abilities.modbus.map_files import ModbusConfig, ModbusUnitConfig
from hil_bench.abilities.modbus.protocol.register_map import Register, RegisterAccess
from hil_bench.bench.configuration import BenchConfig
from hil_bench.cli.arguments import add_bench_arguments, load_bench_config
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import print_lines
from hil_bench.errors import ConfigError, printable

_EXAMPLES = """\
examples:
  hil-bench registers                       the sensors of the built-in bench
  hil-bench registers bench.toml
  hil-bench registers bench.toml --csv > registers.csv      for a PLC's import
"""

COLUMNS = (
    "unit_id",
    "unit",
    "table",
    "address",
    "reference",
    "name",
    "type",
    "count",
    "word_order",
    "unit_of_measure",
    "scale",
    "access",
    "description",
)
"""Columns of the CSV: `address` is that in the frame, `reference` the older notation from 1."""

_SHOWN = ("address", "reference", "name", "type", "unit_of_measure", "scale", "access")
_LEFT = {"name", "type", "unit_of_measure", "access"}


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "registers",
        description="Print the register map of each Modbus unit: tables, addresses, types, units "
        "and who\nmay write. Without [modbus] in the file, the default map.",
        epilog=_EXAMPLES,
    )
    add_bench_arguments(parser)
    parser.add_argument("--csv", action="store_true", help="print CSV, for programs")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the register map."""
    config = load_bench_config(args, modbus=True)
    if args.csv:
        write_csv(config)
    else:
        units = ("\n".join(_unit_lines(unit)) for unit in _units(config))
        print_lines(args, "\n\n".join(units))
    return ExitCode.DONE


def write_csv(config: BenchConfig) -> None:
    """Write one line a register to standard output."""
    writer = csv.DictWriter(sys.stdout, COLUMNS, lineterminator="\n")
    writer.writeheader()
    for unit in _units(config):
        for register in unit.register_map.registers:
            writer.writerow(describe(unit, register))


def describe(unit: ModbusUnitConfig, register: Register) -> dict[str, str]:
    """Return a register as text, by column."""
    is_number = not register.table.holds_bits
    may_write = register.access is RegisterAccess.WRITE or (
        register.access is RegisterAccess.COMMAND and unit.commands
    )
    return {
        "unit_id": str(unit.unit_id),
        "unit": unit.name,
        "table": register.table.value,
        "address": str(register.address),
        "reference": f"{register.reference:05d}",
        "name": register.name,
        "type": register.data_type.name,
        "count": str(register.count),
        "word_order": register.word_order.value if register.count > 1 else "",
        "unit_of_measure": register.unit.symbol if is_number else "",
        "scale": f"{register.scale:g}" if is_number else "",
        "access": "rw" if may_write else "r",
        "description": printable(register.description),
    }


def _units(config: BenchConfig) -> Sequence[ModbusUnitConfig]:
    """Return the units of a configuration.

    Raises:
        ConfigError: there is no Modbus server.
    """
    modbus = config.of(ModbusConfig)
    if modbus is None:
        raise ConfigError("modbus: the file has no table [modbus]; add one")
    return modbus.units


def _unit_lines(unit: ModbusUnitConfig) -> Iterator[str]:
    register_map = unit.register_map
    yield f"unit {unit.unit_id}  {unit.name}  {register_map.profile}"
    yield f"  map    {register_map.source}"
    rows = [describe(unit, register) for register in register_map.registers]
    widths = {name: max(len(row[name]) for row in rows) for name in _SHOWN} if rows else {}
    table = ""
    for row in rows:
        if row["table"] != table:
            table = row["table"]
            yield f"  {table.replace('_', ' ')}"
        cells = "  ".join(
            row[name].ljust(widths[name]) if name in _LEFT else row[name].rjust(widths[name])
            for name in _SHOWN
        )
        order = f"{row['word_order']:6}" if row["word_order"] else " " * 6
        yield f"    {cells}  {order}  {row['description']}".rstrip()
