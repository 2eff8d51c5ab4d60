"""Common parts of the drivers of J1939 devices: NAME, trouble codes, component identification."""

from typing import NamedTuple

from hil_drivers.j1939.identifier import ADDRESS_CLAIMED, COMPONENT, DM1, NULL
from hil_drivers.j1939.name import Name
from hil_drivers.j1939.port import J1939Port

_LEAST_DM1 = 6


class TroubleCode(NamedTuple):
    """A diagnostic trouble code that a device reports.

    Attributes:
        spn: number of the parameter.
        fmi: failure mode.
        occurrences: how often it came; 127 where the device does not say.
    """

    spn: int
    fmi: int
    occurrences: int


class J1939Device:
    """A device at an address, as it shows itself.

    Args:
        port: our end of the bus.
        address: of the device, 0 to 253.

    Attributes:
        port: as passed in.
        address: as passed in; it follows a device whose NAME is known to another address.
        name: its NAME; None until it has said it.
        lamps: of its last DM1, by name: "protect", "warning", "stop", "malfunction".
        trouble_codes: of its last DM1, those that are active.
        reported_at: when that came [s]; -inf before the first.

    Raises:
        ValueError: the address is out of range.
    """

    def __init__(self, port: J1939Port, address: int) -> None:
        if not 0 <= address < NULL:
            raise ValueError(f"J1939 address {address}: 0 to 253 is right")
        self.port, self.address = port, address
        self.name: Name | None = None
        self.lamps: frozenset[str] = frozenset()
        self.trouble_codes: tuple[TroubleCode, ...] = ()
        self.reported_at = -float("inf")
        port.subscribe(ADDRESS_CLAIMED, self._take_claim)
        port.subscribe(DM1, self._take_dm1)

    def __str__(self) -> str:
        return f"J1939 address {self.address}"

    def setup(self) -> None:
        """Ask the device for its NAME.

        A `DriverTimeoutError` says that there is no such device.
        """
        self._take_name(self.port.request(ADDRESS_CLAIMED, self.address))

    def request(self, group: int, *, timeout: float = 1.25) -> bytes:
        """Ask it for a parameter group; see `J1939Port.request`."""
        return self.port.request(group, self.address, timeout=timeout)

    def component(self) -> tuple[str, ...]:
        """Return make, model, serial number and unit number, as far as it says them (PGN 65259)."""
        text = self.request(COMPONENT).decode("latin-1")
        return tuple(part.strip() for part in text.split("*")[:4])

    def _take_claim(self, source: int, data: bytes, _now: float) -> bool:
        if source == self.address:
            self._take_name(data)
        elif self.name is not None and Name.parse(data) == self.name and source < NULL:
            self.address = source
        return True

    def _take_name(self, data: bytes) -> None:
        self.name = Name.parse(data)

    def _take_dm1(self, source: int, data: bytes, now: float) -> bool:
        if source != self.address:
            return True
        if len(data) < _LEAST_DM1:
            return False
        names = ("protect", "warning", "stop", "malfunction")
        self.lamps = frozenset(n for k, n in enumerate(names) if data[0] >> 2 * k & 3 == 1)
        records = [data[at : at + 4] for at in range(2, len(data) - 3, 4)]
        self.trouble_codes = tuple(_code(each) for each in records if any(each))
        self.reported_at = now
        return True


def _code(record: bytes) -> TroubleCode:
    """Return a code by conversion method 4 (SAE J1939-73)."""
    spn = record[0] | record[1] << 8 | (record[2] >> 5) << 16
    return TroubleCode(spn, record[2] & 0x1F, record[3] & 0x7F)
