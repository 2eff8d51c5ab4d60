"""The mapping of a foreign table's columns to quantities: unit, gain, offset and polarity."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hil_bench.abilities.recording.foreign_tables import (
    Columns,
    Values,
    as_recording,
    read_columns,
)
from hil_bench.abilities.recording.reading import in_own_units
from hil_bench.abilities.recording.table_heads import RAW_UNITS
from hil_bench.config.document import read_document
from hil_bench.config.settings import Key, Problems, read_table
from hil_bench.config.values import describe, find_nearest, number, text
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import TIME, Channel, Recording, recording_dtype
from hil_bench.units import ONE, UNITS_OF, SiUnit, Unit, bare_unit, read_unit

_FILES = "files"
_MEASURED = ".measured"
_FULL_SCALE = (Unit("V", "_v", 0.1), Unit("mA", "_ma", 0.05))
"""Units of a command: 10 V and 20 mA are the full opening, where nothing else is said."""

CHANNELS = (
    TIME,
    Channel("position", "m"),
    Channel("P_A", "Pa"),
    Channel("P_B", "Pa"),
    Channel("spool_setpoint", "-"),
    Channel("spool_position", "-"),
)
_UNITS = {channel.name: channel.unit for channel in CHANNELS}
_NEEDED = (TIME.name, "position", "spool_setpoint")


def _polarity(value: object) -> float:
    """Return 1 or -1, or 0 where it is to be found.

    Raises:
        ConfigError: it is none.
    """
    known = {"unknown": 0.0, 1: 1.0, -1: -1.0}
    if not isinstance(value, str | int | float) or isinstance(value, bool) or value not in known:
        raise ConfigError(f'{describe(value)} is no polarity; give 1, -1 or "unknown"')
    return known[value]


_KEYS = (
    Key("column", text, "", ONE, "column"),
    Key("unit", text, "", ONE, "unit"),
    Key("gain", number(), 1.0),
    Key("offset", number(), 0.0),
    Key("polarity", _polarity, 1.0),
    Key("full_scale", number(low=1e-6, high=1e9), None),
)


@dataclass(frozen=True, slots=True)
class Column:
    """The source of a quantity: polarity (gain raw) + offset, in its unit.

    Attributes:
        name: of the column.
        unit: of what gain and offset make of it.
        gain: of the raw values.
        offset: in the unit.
        polarity: 1 or -1; 0 where it is to be found.
    """

    name: str
    unit: Unit
    gain: float = 1.0
    offset: float = 0.0
    polarity: float = 1.0

    def read(self, table: Columns) -> Values:
        """Return the quantity in SI; a polarity of 0 counts as 1."""
        values = (self.polarity or 1.0) * self.gain * table[self.name] + self.offset
        return self.unit.to_si(1.0) * values


Mapped = Mapping[str, Column]
"""The columns by the quantities of `CHANNELS`."""


@dataclass(frozen=True, slots=True)
class ColumnMap:
    """The columns of the recordings.

    Attributes:
        common: of all files.
        files: by the name of a file, what is different there; None for what it lacks.
    """

    common: Mapped
    files: Mapping[str, Mapping[str, Column | None]]

    def of(self, name: str) -> Mapped:
        """Return the columns of a file."""
        both: dict[str, Column | None] = {**self.common, **self.files.get(name, {})}
        return {quantity: column for quantity, column in both.items() if column is not None}


def read_column_map(path: Path | None, options: Sequence[str]) -> ColumnMap:
    """Return the columns that a file and options name; options come first.

    Args:
        path: a TOML file with a table a quantity, as in ``[position]``.
        options: texts COLUMN=[-]QUANTITY:UNIT.
    """
    common: dict[str, Column] = {}
    files: dict[str, dict[str, Column | None]] = {}
    if path is not None:
        document = dict(read_document(path))
        problems = Problems(str(path))
        tables = document.pop(_FILES, {})
        found = _read_tables("", document, problems)
        common = {name: column for name, column in found.items() if column is not None}
        if not isinstance(tables, dict):
            problems.add(problems.place(_FILES), 'is not a table; write it as [files."NAME".P_A]')
        else:
            files = {
                name: _read_tables(f"{_FILES}.{name}", table, problems)
                for name, table in tables.items()
            }
        problems.raise_any()
    return ColumnMap(common | dict(map(_read_option, options)), files)


def check_polarities(path: Path, mapped: Mapped) -> None:
    """Refuse a map that leaves a polarity to be found.

    Raises:
        ConfigError: there is one.
    """
    for name, column in mapped.items():
        if not column.polarity:
            right = "give 1 or -1; identify finds it"
            raise ConfigError(f"{path}: the polarity of {name} is unknown; {right}")


def read_named(path: Path, mapped: Mapped, axis: str) -> Recording:
    """Return a table of another tool as a recording, with the names that a map gives its columns.

    Args:
        path: of the table, CSV, MAT or MF4.
        mapped: some of its columns; the others keep their names and units.
        axis: the name that the quantities get.

    Raises:
        ConfigError: the table cannot be read, or the map and the table contradict each other.
    """
    table, units = read_columns(path)
    try:
        check_units(units, mapped)
        _check_columns(table, mapped)
        taken = {column.name for column in mapped.values()}
        columns = {name: values for name, values in table.items() if name not in taken}
        for quantity, column in mapped.items():
            name = quantity if quantity == TIME.name else f"{axis}.{quantity}"
            columns[name], units[name] = column.read(table), _UNITS[quantity]
        return in_own_units(as_recording(columns, units))
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def read_mapped(path: Path, mapped: Mapped, axis: str) -> Recording:
    """Return the recording of an axis in a table of another tool.

    Args:
        path: of the table, CSV, MAT or MF4.
        mapped: its columns.
        axis: the name that its quantities get.

    Raises:
        ConfigError: the table cannot be read, or the map and the table contradict each other.
    """
    table, units = read_columns(path)
    try:
        check_units(units, mapped)
        return map_columns(table, mapped, axis)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def map_columns(table: Columns, mapped: Mapped, axis: str) -> Recording:
    """Return the recording of an axis that the columns of a table make.

    What a polarity of 0 leaves open is as it stands in the table.

    Raises:
        ConfigError: a needed quantity has no column, or the table lacks one.
    """
    missing = [name for name in _NEEDED if name not in mapped]
    if missing:
        raise ConfigError(
            f"no column is {' and '.join(missing)}; give each in --columns or with --map "
            f"COLUMN={missing[0]}:UNIT; the file has {', '.join(table)}"
        )
    _check_columns(table, mapped)
    channels = [
        channel if channel is TIME else channel._replace(name=f"{axis}.{channel.name}")
        for channel in CHANNELS
        if channel.name in mapped
    ]
    rows = len(table[mapped[TIME.name].name])
    recording = np.zeros(rows, dtype=recording_dtype(channels))
    for channel in channels:
        recording[channel.name] = mapped[channel.name.rpartition(".")[2]].read(table)
    recording[TIME.name] -= recording[TIME.name][:1]
    return recording


def _check_columns(table: Columns, mapped: Mapped) -> None:
    """Refuse a map of columns that a table lacks.

    Raises:
        ConfigError: there is one.
    """
    for quantity, column in mapped.items():
        if column.name not in table:
            names = ", ".join(table)
            raise ConfigError(f"{quantity} is to be column {column.name}; the file has {names}")


def check_units(units: Mapping[str, str], mapped: Mapped) -> None:
    """Refuse a map that gives a column another unit than its file does.

    Args:
        units: of the file, by the name of the column; those that are not known say nothing, but
            for those of a sensor's signal, as V or counts.
        mapped: the columns; one with a gain or an offset is raw, so its unit is not the file's.

    Raises:
        ConfigError: there is one.
    """
    for quantity, column in mapped.items():
        symbol = bare_unit(units.get(column.name, ""))
        given = read_unit(symbol)
        if (column.gain, column.offset) != (1.0, 0.0) or given == SiUnit(ONE.symbol):
            continue
        if symbol.casefold() in RAW_UNITS and symbol.casefold() != column.unit.symbol.casefold():
            is_command = _UNITS[quantity] == "-" and symbol in {each.symbol for each in _FULL_SCALE}
            right = f"give it in {symbol}" if is_command else "give gain and offset"
            raise ConfigError(
                f'column {column.name} is in "{symbol}" there, and the map has {quantity} in '
                f"{column.unit.symbol}; {right} in a file for --columns"
            )
        if given is None:
            continue
        factor = given.factor if given.symbol == _UNITS[quantity] else math.nan
        if not math.isclose(factor, column.unit.factor) or given.offset:
            raise ConfigError(
                f'column {column.name} is in "{units[column.name]}" there, and the map has '
                f"{quantity} in {column.unit.symbol}; give the map the unit of the file"
            )


def take_sensors(
    recording: Recording, axis: str, sensors: Mapping[str, str]
) -> tuple[Recording, str]:
    """Return a bench's recording with what its sensors measured in place of the plant's own values.

    Args:
        recording: of the bench.
        axis: its axis.
        sensors: the name of the sensor of each quantity.

    Returns:
        The recording, and a note that says which columns are taken; without a note it has no column
        of a sensor, as that of a machine.
    """
    names = recording.dtype.names or ()
    ours = (TIME.name, f"{axis}.")
    if not any(name.endswith(_MEASURED) for name in names if not name.startswith(ours)):
        return recording, ""
    found = recording.copy()
    taken = {}
    for quantity in (channel.name for channel in CHANNELS[1:]):
        column = f"{sensors[quantity]}{_MEASURED}" if quantity in sensors else ""
        if f"{axis}.{quantity}" in names:
            is_there = column in names
            taken[quantity] = column if is_there else f"{axis}.{quantity}, the plant's own"
            if is_there:
                found[f"{axis}.{quantity}"] = recording[column]
    return found, "taken: " + "; ".join(f"{name} from {column}" for name, column in taken.items())


def _read_tables(prefix: str, tables: object, problems: Problems) -> dict[str, Column | None]:
    if not isinstance(tables, dict):
        problems.add(problems.place(prefix), f"{describe(tables)} is not a table")
        return {}
    found: dict[str, Column | None] = {}
    for quantity, table in tables.items():
        place = problems.place(prefix, quantity)
        if quantity not in _UNITS:
            nearest = find_nearest(quantity, _UNITS)
            problems.add(place, f"unknown quantity; the nearest known one is {nearest}")
        elif table is False and prefix:
            found[quantity] = None
        elif not isinstance(table, dict):
            problems.add(place, f"{describe(table)} is not a table; write it as [{quantity}]")
        else:
            column = _read_column(prefix, quantity, table, problems)
            if column is not None:
                found[quantity] = column
    return found


def _read_column(
    prefix: str, quantity: str, table: dict[str, object], problems: Problems
) -> Column | None:
    name = f"{prefix}.{quantity}" if prefix else quantity
    settings = read_table(name, table, _KEYS, problems)
    values = {key: setting.value for key, setting in settings.items()}
    if len(values) < len(_KEYS):
        return None
    try:
        unit = _scaled_unit(quantity, values)
    except ConfigError as error:
        problems.add(problems.place(name), error)
        return None
    return Column(values["column"], unit, values["gain"], values["offset"], values["polarity"])


def _scaled_unit(quantity: str, values: Mapping[str, Any]) -> Unit:
    """Return the unit of a column, by its full scale where that is given.

    Raises:
        ConfigError: the column or its unit is missing, or its full scale has no meaning.
    """
    if not values["column"]:
        raise ConfigError('column is missing; give for example column = "s [mm]"')
    unit = _find_unit(quantity, values["unit"])
    if values["full_scale"] is None:
        return unit
    if quantity not in {"spool_setpoint", "spool_position"}:
        raise ConfigError("full_scale is for spool_setpoint and spool_position; give gain")
    return unit._replace(factor=1.0 / values["full_scale"])


def _read_option(option: str) -> tuple[str, Column]:
    """Return a quantity and its column.

    Raises:
        ConfigError: the option names none.
    """
    name, sign, right = option.rpartition("=")
    quantity, _, symbol = right.partition(":")
    polarity = -1.0 if quantity.startswith("-") else 1.0
    quantity = quantity.removeprefix("-")
    if not sign or not name or quantity not in _UNITS:
        raise ConfigError(
            f"--map {option}: give COLUMN=QUANTITY:UNIT with a quantity of {', '.join(_UNITS)}; "
            "-QUANTITY turns the sign"
        )
    try:
        unit = _find_unit(quantity, symbol)
    except ConfigError as error:
        raise ConfigError(f"--map {option}: {error}") from None
    return quantity, Column(name, unit, polarity=polarity)


def _find_unit(quantity: str, symbol: str) -> Unit:
    """Return a unit of a quantity.

    Raises:
        ConfigError: there is no such unit for it, or none is given.
    """
    units = UNITS_OF[_UNITS[quantity]]
    if _UNITS[quantity] == "-":
        units += _FULL_SCALE
    for unit in units:
        if unit.symbol == symbol:
            return unit
    spelled = read_unit(symbol)
    if spelled is not None and spelled.symbol == _UNITS[quantity]:
        return Unit(symbol, "", spelled.factor)
    known = ", ".join(unit.symbol for unit in units)
    wrong = f"unit {symbol} is unknown" if symbol else "the unit is missing"
    raise ConfigError(f"{wrong}; {quantity} has one of {known}")
