"""Common parts of the drivers of all devices: identity, PDOs, freshness of values."""

import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import ClassVar, NamedTuple

from hil_drivers.errors import DeviceMismatchError, StaleValueError
from hil_drivers.network import Network
from hil_drivers.node import object_name
from hil_drivers.pdo import (
    INVALID,
    ObjectKey,
    PdoKind,
    PdoMapping,
    ReceivedPdo,
    Signal,
    choose_carriers,
    configure_pdo,
    eds_mappings,
    verify_mapping,
)
from hil_drivers.protection import Protection


class Input(NamedTuple):
    """A value of the device: which received PDO brings it, and where in it it stands."""

    pdo: ReceivedPdo
    signal: Signal


class Device:
    """Base of the drivers.

    Args:
        network: the network that the device is on.
        node_id: its node-ID.
        eds: its EDS; everything about the device is taken from there.
        max_age: values older than this [s] are refused.

    Attributes:
        network: as passed in.
        node: the device as a CANopen node, for access to its raw objects.
        max_age: as passed in; may be changed.
    """

    PROFILE: ClassVar[int]
    """Number of the device profile, the low word of 0x1000."""

    def __init__(
        self, network: Network, node_id: int, eds: Path | str, *, max_age: float = 0.1
    ) -> None:
        self.network = network
        self.node = network.add_node(node_id, eds)
        self.max_age = max_age
        self._received: list[ReceivedPdo] = []

    @property
    def received_at(self) -> float:
        """When the oldest of its values came, on the network's clock [s]; -inf before the first."""
        return min(pdo.received_at for pdo in self._received)

    @property
    def age(self) -> float:
        """Time since the oldest of its values came [s]; infinite before the first."""
        return self.network.now() - self.received_at

    @property
    def primary(self) -> Input:
        """The PDO that brings the device's own quantity, and where in it that stands."""
        raise NotImplementedError

    def __str__(self) -> str:
        return str(self.node)

    def expect_protection(self, tpdos: Collection[int]) -> None:
        """Refuse PDOs without a right counter and checksum from these TPDOs, by their numbers."""
        for pdo in self._received:
            if pdo.mapping.number in tpdos:
                pdo.protection = Protection(pdo.cob_id)

    def poll(self) -> bool:
        """Return False: CANopen devices send by themselves, as `setup` has configured."""
        return False

    def _first_mapped(self, candidates: Sequence[ObjectKey]) -> ObjectKey:
        """Return the first of these objects that a TPDO carries; TPDOs that exist come first."""
        mappings = eds_mappings(self.node, PdoKind.TPDO)
        for some in ([m for m in mappings if not m.cob_id & INVALID], mappings):
            for key in candidates:
                if any(key in mapping for mapping in some):
                    return key
        raise self._not_mapped(PdoKind.TPDO, " or ".join(object_name(*key) for key in candidates))

    def _carriers(
        self, kind: PdoKind, required: Sequence[ObjectKey], optional: Sequence[ObjectKey] = ()
    ) -> dict[ObjectKey, PdoMapping]:
        """Return the PDO to use for each object; optional objects may be left out."""
        carriers = choose_carriers(eds_mappings(self.node, kind), [*required, *optional])
        for key in required:
            if key not in carriers:
                raise self._not_mapped(kind, object_name(*key))
        return carriers

    def _not_mapped(self, kind: PdoKind, what: str) -> DeviceMismatchError:
        return DeviceMismatchError(
            f"{self.node}: no {kind.name} of {self.node.eds} carries {what}; "
            "an EDS that maps it is right"
        )

    def _add_inputs(self, carriers: Mapping[ObjectKey, PdoMapping]) -> dict[ObjectKey, Input]:
        """Add the received PDOs of these objects and return an input for each object."""
        pdos = {mapping: ReceivedPdo(mapping) for mapping in carriers.values()}
        self._received.extend(pdos.values())
        return {
            key: Input(pdos[mapping], Signal(mapping, key, self.node.variable(*key)))
            for key, mapping in carriers.items()
        }

    def _set_up(
        self, *, transmission_type: int, event_timer: float, heartbeat_period: float
    ) -> None:
        """Check the device and set how it sends; see `setup` of the drivers.

        Raises:
            ValueError: the transmission type is none.
        """
        if not (0 <= transmission_type <= 240 or transmission_type in {254, 255}):
            raise ValueError(
                f"transmission type {transmission_type}: 0 to 240, 254 or 255 is right (CiA 301)"
            )
        milliseconds("event timer", event_timer)
        period_ms = milliseconds("heartbeat period", heartbeat_period)
        self._check_identity()
        for pdo in self._received:
            verify_mapping(self.node, pdo.mapping)
            cob_id = configure_pdo(
                self.node,
                pdo.mapping,
                transmission_type=transmission_type,
                event_timer=event_timer,
            )
            pdo.cob_id = cob_id
            if pdo.protection is not None:
                pdo.protection.cob_id = cob_id
            self.network.subscribe(cob_id, pdo.receive)
        if self.node.has(0x1017):
            self.node.write(0x1017, 0, period_ms)

    def _check_identity(self) -> None:
        """Compare profile, vendor and product of EDS and device.

        Raises:
            DeviceMismatchError: they differ.
        """
        node = self.node
        profile = node.read_device_type() & 0xFFFF
        if profile != self.PROFILE:
            raise DeviceMismatchError(
                f"{node}: 0x1000 (device type) says profile {profile}; {self.PROFILE} is right"
            )
        for subindex in (1, 2):
            expected = node.default(0x1018, subindex, otherwise=0)
            if expected and (found := node.read_integer(0x1018, subindex)) != expected:
                raise DeviceMismatchError(
                    f"{node}: {object_name(0x1018, subindex)} "
                    f"({node.variable(0x1018, subindex).qualname}) is 0x{found:X}; "
                    f"0x{expected:X} is right by {node.eds}"
                )

    def _value(self, source: Input) -> int | float:
        """Return the present value of an input."""
        pdo, signal = source
        age = self.network.now() - pdo.received_at
        if age > self.max_age:
            raise self._stale(pdo, age)
        return signal.decode(pdo.data)

    def _stale(self, pdo: ReceivedPdo, age: float) -> StaleValueError:
        where = f"{self.node}: {pdo.mapping} (COB-ID 0x{pdo.mapping.cob_id & 0x7FF:X})"
        if math.isinf(age):
            return StaleValueError(
                f"{where} never came; setup() and NMT state OPERATIONAL bring it"
            )
        return StaleValueError(
            f"{where} came {1000 * age:.1f} ms ago; at most {1000 * self.max_age:g} ms are right"
        )


class Sensor(Device):
    """Base of the drivers of sensors."""

    def setup(
        self,
        *,
        transmission_type: int = 1,
        event_timer: float = 0.0,
        heartbeat_period: float = 0.1,
        protected: bool = False,
    ) -> None:
        """Check the device, read its scaling, and set how it sends.

        Args:
            transmission_type: 1 to 240 sends with each n-th SYNC, 254 or 255 by event.
            event_timer: longest time between two values [s]; 0 is none.
            heartbeat_period: between the device's heartbeats [s]; 0 is none.
            protected: whether its PDOs have a counter and a checksum, without which they are then
                refused; see `protections`.
        """
        for pdo in self._received:
            cob_id = pdo.mapping.cob_id & 0x7FF
            pdo.protection = Protection(cob_id) if protected else None
        self._set_up(
            transmission_type=transmission_type,
            event_timer=event_timer,
            heartbeat_period=heartbeat_period,
        )
        self._read_scaling()

    @property
    def protections(self) -> list[Protection]:
        """Counters of its protected PDOs: accepted, wrong, repeated and lost frames of each."""
        return [pdo.protection for pdo in self._received if pdo.protection is not None]

    def _read_scaling(self) -> None:
        """Read from the device what one digit of its values stands for."""
        raise NotImplementedError


def milliseconds(what: str, time: float) -> int:
    """Return a time [s] as the whole milliseconds that CANopen's timers hold.

    Raises:
        ValueError: it is negative, longer than the timers hold, or would round to none.
    """
    if not 0 <= time <= 65.535 or 0 < time <= 0.0005:
        raise ValueError(f"{what} {time} s: 0 for none, or 0.001 to 65.535 s is right")
    return round(time * 1000)
