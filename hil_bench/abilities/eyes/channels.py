"""Channels of a recording in SI: PDOs, J1939 messages of known devices, messages of a DBC file."""

import math
import re
from collections.abc import Iterable
from typing import Final

from hil_bench.abilities.eyes.dbc_words import DbcMessages
from hil_bench.abilities.eyes.known_ecu import KnownEcu, KnownValue
from hil_bench.abilities.eyes.known_node import PdoOwner
from hil_bench.abilities.eyes.pdos import PdoField
from hil_bench.abilities.eyes.sight import J1939Message, Sight
from hil_bench.abilities.eyes.values import Reading
from hil_bench.outside.recording.channels import Channel
from hil_bench.units import ONE, read_unit, si_unit

_NO_WORD: Final = re.compile(r"[^0-9A-Za-z]+")

_Key = tuple[int, int, int, int]
"""Bus, node-ID, index and sub-index."""


def symbol_of(name: str) -> str:
    """Return the name of an object as one word, as in ``spool_actual_value``."""
    return word_of(name).lower()


def word_of(name: str) -> str:
    """Return a name as one word, in its own case."""
    return _NO_WORD.sub("_", name.strip()).strip("_")


class BusChannels:
    """Holds the last value of each number that a PDO or a J1939 message carries.

    Args:
        owners: the PDOs.
        ecus: the J1939 devices.
        dbc: the messages of all other frames.

    Attributes:
        channels: one an object with numbers, its name is node and object; and one a J1939 signal.
        missed: values that came of objects without a channel: mapped after the recording began.
    """

    def __init__(
        self,
        owners: Iterable[PdoOwner],
        ecus: Iterable[KnownEcu] = (),
        dbc: DbcMessages | None = None,
    ) -> None:
        self._dbc = dbc or DbcMessages(None)
        self._signals: dict[tuple[str, str], tuple[int, float]] = {}
        self.missed = 0
        self.channels: list[Channel] = []
        self._places: dict[_Key, tuple[int, float]] = {}
        self._told: dict[tuple[int, int], list[tuple[int, str, KnownValue]]] = {}
        self._values: list[float] = []
        self._names: set[str] = set()
        for owner in owners:
            for field in owner.pdo.fields:
                self._add(owner, field)
        for ecu in ecus:
            for value in ecu.values:
                place = self._open(f"{ecu.name}.{value.name}", f"PGN_{value.group}", value.unit)
                told = self._told.setdefault((ecu.bus, value.group), [])
                told.append((place, ecu.name, value))
        for message, signal, unit in self._dbc.signals():
            symbol, factor = si_unit(unit)
            name = f"{word_of(message)}.{word_of(signal)}"
            self._signals[message, signal] = self._open(name, "dbc", symbol), factor

    def _add(self, owner: PdoOwner, field: PdoField) -> None:
        reader, node = field.reader, owner.node
        key = node.bus, node.node_id, reader.index, reader.subindex
        if key in self._places or not _is_number(field):
            return
        place = f"0x{reader.index:04X}_{reader.subindex:02X}"
        name = f"{symbol_of(node.name)}.{symbol_of(reader.name) or place}"
        unit = ONE if reader.scale is None else reader.scale.unit
        self._places[key] = self._open(name, place, _si_symbol(unit.symbol)), unit.factor

    def _open(self, name: str, place: str, unit: str) -> int:
        """Open a channel, and return its number; its place tells it from another of its name."""
        if name in self._names:
            name = f"{name}_{place}"
        self._names.add(name)
        self.channels.append(Channel(name, unit))
        self._values.append(math.nan)
        return len(self.channels) - 1

    def take(self, sight: Sight) -> bool:
        """Hold the values of a PDO or a message, and return whether there were some."""
        has_values = sight.message is not None and self._take_message(sight, sight.message)
        for reading in sight.readings:
            place = self._places.get(_key(sight, reading))
            if place is None:
                self.missed += 1
            elif not isinstance(reading.value, str):
                number, factor = place
                self._values[number] = reading.value * factor
                has_values = True
        for signal, value in self._dbc.numbers(sight).items():
            number, factor = self._signals[signal]
            self._values[number] = value * factor
            has_values = True
        return has_values

    def _take_message(self, sight: Sight, message: J1939Message) -> bool:
        """Hold what its sender says with it, and what it says to those whom it is meant for."""
        if message.data is None:
            return False
        has_values = False
        for place, device, value in self._told.get((sight.frame.bus, message.group), ()):
            if device == sight.node if value.is_sent else message.receiver in {"", device}:
                self._values[place] = value.read(message.data)
                has_values = True
        return has_values

    def row(self, now: int) -> tuple[float, ...]:
        """Return a row of a recording: time [s] and the last values, NaN before the first."""
        return now * 1e-9, *self._values


def _key(sight: Sight, reading: Reading) -> _Key:
    return sight.frame.bus, sight.node_id or 0, reading.object_index, reading.subindex


def _si_symbol(symbol: str) -> str:
    """Return the unit of a value times its unit's factor; CiA 303-2 has prefixes, as in hbar."""
    found = read_unit(symbol) or read_unit(symbol[1:])
    return symbol if found is None else found.symbol


def _is_number(field: PdoField) -> bool:
    data_type = field.reader.data_type
    return data_type is not None and not isinstance(data_type.zero, (str, bytes))
