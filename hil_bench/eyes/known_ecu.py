"""J1939 devices that a decoder knows beforehand: those of a bench."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from hil_bench.bench.configuration import BenchConfig
from hil_bench.devices.j1939.signals import Signal
from hil_bench.kinds.signal_table import SignalTableConfig


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

    def text(self, data: bytes) -> str:
        """Return name and value in a message."""
        raw = self.signal.raw_in(data)
        if raw == self.signal.not_available:
            return f"{self.name} not available"
        if raw > self.signal.highest:
            return f"{self.name} error" if raw == self.signal.error else f"{self.name} reserved"
        unit = "" if self.unit == "-" else f" {self.unit}"
        return f"{self.name} {self.signal.value(data):.6g}{unit}"


@dataclass(frozen=True, slots=True)
class KnownEcu:
    """A J1939 device.

    Attributes:
        name: in the bench.
        bus: its number.
        address: that it claims first.
        identity: its NAME, as a number.
        signals: what it sends, by parameter group.
    """

    name: str
    bus: int
    address: int
    identity: int
    signals: Mapping[int, tuple[KnownSignal, ...]] = field(default_factory=dict)


def ecus_of(config: BenchConfig) -> Iterator[KnownEcu]:
    """Yield the J1939 devices of a bench."""
    buses = list(config.buses)
    for ecu in config.ecus:
        signals: dict[int, list[KnownSignal]] = {}
        for sent in ecu.sent if isinstance(ecu, SignalTableConfig) else ():
            known = KnownSignal(sent.name, sent.signal, sent.unit)
            signals.setdefault(sent.group, []).append(known)
        by_group = {group: tuple(found) for group, found in signals.items()}
        yield KnownEcu(ecu.name, buses.index(ecu.bus), ecu.address, int(ecu.identity), by_group)
