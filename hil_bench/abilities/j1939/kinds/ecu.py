"""A kind of J1939 device: one object describes it completely to the bench."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Generic, NamedTuple, TypeVar

from hil_bench.abilities.j1939.protocol.ecu import Ecu
from hil_bench.abilities.j1939.protocol.signal_table import SentSignal
from hil_bench.abilities.j1939.protocol.signals import EcuValue, Name
from hil_bench.config.settings import Key, Problems, Settings
from hil_bench.devices.axis import Fitting
from hil_bench.devices.kinds.bindings import Surroundings
from hil_bench.plants.plant import AxisSettings


@dataclass(frozen=True, slots=True)
class EcuConfig:
    """The settings common to all J1939 devices.

    Attributes:
        name: the device, as in ``[j1939.NAME]``.
        kind: of device.
        bus: the name of the bus that it is on.
        address: that it claims first.
        identity: its NAME.
        component: make, model, serial number and unit number for PGN 65259; empty for none.
        place: how messages name its table.
    """

    name: str
    kind: "EcuKind[Any]"
    bus: str
    address: int
    identity: Name
    component: str
    place: str = field(compare=False)


EcuT = TypeVar("EcuT", bound=EcuConfig)


class EcuMessage(NamedTuple):
    """A parameter group that a J1939 device sends or takes.

    Attributes:
        group: its PGN.
        is_sent: whether the device sends it.
        period: between two [ns]; 0 where it is sent on request only, or taken.
        signals: what it carries that this bench knows, in words.
    """

    group: int
    is_sent: bool
    period: int
    signals: tuple[str, ...]


class EcuFitting(NamedTuple):
    """The behaviour of a J1939 device on the bench, beside the services of its ECU.

    Attributes:
        fitting: as that of a CANopen device.
        signals: what it sends and a fault may indicate, by name.
        values: what it shows, by name.
    """

    fitting: Fitting
    signals: Mapping[str, SentSignal] = MappingProxyType({})
    values: Mapping[str, EcuValue] = MappingProxyType({})


class EcuKind(ABC, Generic[EcuT]):
    """A kind of J1939 device.

    Attributes:
        name: as in ``kind = "NAME"``.
        record: what its table becomes; each of `keys` fills an attribute of it.
        keys: of its table, beside those of every J1939 device.
        has_axis: whether it belongs to an axis.
    """

    name: str
    record: type[EcuT]
    keys: tuple[Key, ...] = ()
    has_axis: bool = False

    @abstractmethod
    def fit(self, config: EcuT, ecu: Ecu, surroundings: Surroundings) -> EcuFitting:
        """Build the device on its ECU, and return what it does on the bench."""

    def messages(self, config: EcuT) -> tuple[EcuMessage, ...]:
        """List the messages that it sends and takes, beside the services of every ECU."""
        return ()

    def check(self, table: str, device: Settings, axis: AxisSettings, problems: Problems) -> None:
        """Note what of a device does not go with the plant of its axis."""

    def resolve(self, device: Settings, axis: AxisSettings) -> None:
        """Fill in what a device takes from its axis."""

    def axis_of(self, config: EcuT) -> str | None:
        """Return the axis that the device belongs to; None where all of it is in its signals."""
        return None

    def full_scales(self, config: EcuT) -> Mapping[str, float]:
        """Return the command of 100 % [SI] of each axis that it commands."""
        return MappingProxyType({})
