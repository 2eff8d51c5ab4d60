"""J1939 devices that a decoder knows beforehand: those of a bench."""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

from hil_bench.abilities.j1939.kinds.auxiliary_valve import FLOW, SET_POINT, AuxiliaryValveConfig
from hil_bench.abilities.j1939.kinds.ecu import EcuConfig
from hil_bench.abilities.j1939.kinds.signal_table import SignalTableConfig
from hil_bench.abilities.j1939.protocol.auxiliary_valve import COMMAND, ESTIMATED_FLOW, command_in
from hil_bench.abilities.j1939.protocol.auxiliary_valve import FLOW as FLOW_PLACE
from hil_bench.abilities.j1939.protocol.signals import Signal
from hil_bench.bench.configuration import BenchConfig
from hil_bench.units import ONE, si_unit


@dataclass(frozen=True, slots=True)
class KnownSignal:
    """A signal of a parameter group.

    Attributes:
        name: of the signal.
        signal: its place.
        unit: symbol of its unit; "-" for none.
    """

    name: str
    signal: Signal
    unit: str

    def words(self, data: bytes, shown: str) -> str:
        """Return name and value in a message, of which it is known what the signal shows."""
        if shown:
            return f"{self.name} {shown}"
        unit = "" if self.unit == "-" else f" {self.unit}"
        raw, signal = self.signal.raw_in(data), self.signal
        return f"{self.name} {raw * signal.resolution + signal.offset:.6g}{unit}"

    def shown(self, data: bytes) -> str:
        """Return the indicator in a message: "error", "not available"; empty for a value."""
        return self.signal.indicator_in(data)


@dataclass(frozen=True, slots=True)
class KnownValue:
    """A number in a parameter group that a device sends or takes.

    Attributes:
        name: of the number.
        unit: symbol of its SI unit.
        group: the PGN.
        is_sent: whether the device sends it.
        read: returns it [SI]; NaN where the data have no valid one.
    """

    name: str
    unit: str
    group: int
    is_sent: bool
    read: Callable[[bytes], float]


@dataclass(frozen=True, slots=True)
class KnownEcu:
    """A J1939 device.

    Attributes:
        name: in the bench.
        bus: its number.
        address: that it claims first.
        identity: its NAME, as a number.
        signals: what it sends, by parameter group.
        priorities: of these groups, where the bench gives one.
        values: the numbers that it sends and takes.
    """

    name: str
    bus: int
    address: int
    identity: int
    signals: Mapping[int, tuple[KnownSignal, ...]] = field(default_factory=dict)
    priorities: Mapping[int, int] = field(default_factory=dict)
    values: tuple[KnownValue, ...] = ()

    def narrowed(self, groups: Collection[tuple[int, int]]) -> "KnownEcu":
        """Return it with the values of these parameter groups alone, each with its bus."""
        return replace(
            self, values=tuple(each for each in self.values if (self.bus, each.group) in groups)
        )


def ecus_of(config: BenchConfig) -> Iterator[KnownEcu]:
    """Yield the J1939 devices of a bench."""
    buses = list(config.buses)
    for ecu in config.ecus:
        signals: dict[int, list[KnownSignal]] = {}
        priorities: dict[int, int] = {}
        for sent in ecu.sent if isinstance(ecu, SignalTableConfig) else ():
            known = KnownSignal(sent.name, sent.signal, sent.unit)
            signals.setdefault(sent.group, []).append(known)
            if sent.priority is not None:
                priorities[sent.group] = sent.priority
        by_group = {group: tuple(found) for group, found in signals.items()}
        yield KnownEcu(
            ecu.name,
            buses.index(ecu.bus),
            ecu.address,
            int(ecu.identity),
            by_group,
            priorities,
            tuple(_values_of(ecu)),
        )


def _values_of(ecu: EcuConfig) -> Iterator[KnownValue]:
    """Yield what the messages of a device say in numbers, with the names that the bench has."""
    if isinstance(ecu, SignalTableConfig):
        for sent in ecu.sent:
            symbol, factor = si_unit(sent.unit)
            read = partial(_scaled, sent.signal, factor)
            yield KnownValue(sent.name, symbol, sent.group, True, read)
        for taken in ecu.taken:
            read = partial(_scaled, taken.signal, 1.0 / taken.scale)
            yield KnownValue(taken.name, ONE.symbol, taken.group, False, read)
    elif isinstance(ecu, AuxiliaryValveConfig):
        command, flow = COMMAND + ecu.number, ESTIMATED_FLOW + ecu.number
        yield KnownValue(SET_POINT, ONE.symbol, command, False, command_in)
        yield KnownValue(FLOW.name, FLOW.unit, flow, True, partial(_scaled, FLOW_PLACE, 1e-2))


def _scaled(signal: Signal, factor: float, data: bytes) -> float:
    return signal.value(data) * factor
