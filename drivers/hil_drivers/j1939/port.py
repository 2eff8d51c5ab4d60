"""A controller's end of J1939 on the bus of a `Network`: address, requests, messages."""

import contextlib
from collections.abc import Callable, Mapping
from typing import Final

import can

from hil_drivers.errors import (
    AddressClaimError,
    BusLostError,
    DriverTimeoutError,
    RequestRefusedError,
)
from hil_drivers.j1939.address_claim import CONTENTION, AddressClaim, ClaimState
from hil_drivers.j1939.identifier import (
    ACKNOWLEDGEMENT,
    ADDRESS_CLAIMED,
    GLOBAL,
    NULL,
    REQUEST,
    TRANSPORT_CONTROL,
    TRANSPORT_DATA,
    join,
    split,
)
from hil_drivers.j1939.name import Name
from hil_drivers.j1939.reception import Reception
from hil_drivers.j1939.transmission import Transmission
from hil_drivers.network import Network

Take = Callable[[int, bytes, float], bool]
"""Takes a message of a parameter group: source, data, time [s]; False refuses it as malformed."""

USUAL_PRIORITY: Final = 6

_TRANSPORT_PRIORITY: Final = 7
_REFUSALS: Final = {1: "refused", 2: "access denied", 3: "busy"}


class J1939Port:
    """Our address on J1939, and all that is sent from it or comes to it.

    It receives and answers while the caller waits in its network, as CANopen devices on the same
    bus do. Where the bus was lost and is back, it claims its address again.

    Args:
        network: of the bus.
        name: our NAME.
        address: that we want, 0 to 253.

    Attributes:
        network: as passed in.
        name: as passed in.
        reception: the long messages that come.

    Raises:
        ValueError: the address or a field of the NAME is out of range, or there is a port already.
    """

    def __init__(self, network: Network, name: Name, address: int) -> None:
        if not 0 <= address < NULL:
            raise ValueError(f"J1939 address {address}: 0 to 253 is right")
        if network.take_extended is not None:
            raise ValueError("the network has a J1939 port already; one is enough")
        self.network, self.name = network, name
        self.reception = Reception(self._control, self._deliver)
        self._transmission = Transmission(self._control, self._packet)
        self._claim = AddressClaim(name, address, self._say_address)
        self._takers: dict[int, list[Take]] = {}
        self._services: Mapping[int, Callable[[int, bytes], bool]] = {
            REQUEST: self._take_request,
            ACKNOWLEDGEMENT: self._take_acknowledgement,
        }
        self._refused: dict[tuple[int, int], str] = {}
        self._returns = network.returns
        network.take_extended = self._take
        network.add_service(self._serve)

    @property
    def address(self) -> int:
        """Our address; 254 for none."""
        return self._claim.address

    @property
    def state(self) -> ClaimState:
        """The state of our address claim."""
        return self._claim.state

    def claim(self, *, timeout: float = 2.0) -> int:
        """Claim our address, and return it; another one than wanted where our NAME allows that.

        An `AddressClaimError` says that another device has it, and we may take no other.

        Raises:
            DriverTimeoutError: others contend again and again.
        """
        self._claim.begin(self.network.now())
        self.network.wait_for(self._is_settled, max(timeout, CONTENTION))
        if self.state is ClaimState.CLAIMING:
            raise DriverTimeoutError(f"J1939 address claim: not within {timeout:g} s")
        self._check()
        return self.address

    def subscribe(self, group: int, take: Take) -> None:
        """Have the messages of a parameter group told, whoever sends them; more may listen."""
        takers = self._takers.setdefault(group, [])
        if take not in takers:
            takers.append(take)

    def send(
        self,
        group: int,
        data: bytes,
        destination: int = GLOBAL,
        priority: int = USUAL_PRIORITY,
        *,
        timeout: float = 30.0,
    ) -> None:
        """Send a message of up to 1785 bytes; an `AddressClaimError` says that we have no address.

        One of more than eight bytes goes by the transport protocol: to a device by RTS and CTS, to
        all by BAM, which takes 50 ms for seven bytes. The caller waits in the network until it has
        arrived, or has gone to all. A `TransferAbortedError` says that it was ended before, a
        `DriverTimeoutError` that the device does not answer or the time is over.

        Args:
            group: its PGN.
            data: of the message.
            destination: address of the receiver.
            priority: of its frame; a long message has that of the transport protocol.
            timeout: longest time of a long message [s].
        """
        self._check()
        if len(data) <= 8:
            self._put(priority, group, destination, data)
            return
        transfer = self._transmission.begin(group, data, destination, self.network.now())
        try:
            self.network.wait_for(lambda: transfer.is_over, timeout)
        finally:
            with contextlib.suppress(BusLostError):
                self._transmission.give_up(transfer, timeout)
        if transfer.error is not None:
            raise transfer.error

    def request(self, group: int, address: int, *, timeout: float = 1.25) -> bytes:
        """Ask a device for a parameter group, and return its data.

        Raises:
            RequestRefusedError: it does not have it.
            DriverTimeoutError: it does not answer.
        """
        found: list[bytes] = []

        def take(source: int, data: bytes, _now: float) -> bool:
            if source == address:
                found.append(data)
            return True

        takers = self._takers.setdefault(group, [])
        takers.append(take)
        key = (group, address)
        self._refused.pop(key, None)
        try:
            self.send(REQUEST, group.to_bytes(3, "little"), address)
            self.network.wait_for(lambda: bool(found) or key in self._refused, timeout)
        finally:
            takers.remove(take)
        what = f"J1939 address {address}: PGN {group}"
        if found:
            return found[0]
        if key in self._refused:
            raise RequestRefusedError(f"{what}: {self._refused.pop(key)}")
        raise DriverTimeoutError(f"{what}: not within {timeout:g} s")

    def _is_settled(self) -> bool:
        return self.state is not ClaimState.CLAIMING

    def _check(self) -> None:
        if self.state is not ClaimState.CLAIMED:
            why = {
                ClaimState.NONE: "none is claimed; call claim",
                ClaimState.CLAIMING: "the claim is under way; wait for it",
                ClaimState.LOST: "a device of a smaller NAME has it",
            }[self.state]
            raise AddressClaimError(f"J1939 address: {why}")

    def _serve(self, now: float) -> float:
        if self.network.returns != self._returns:
            self._returns = self.network.returns
            self._claim_again(now)
        due = self._claim.serve(now)
        if self._transmission.is_busy and self.state is not ClaimState.CLAIMED:
            self._transmission.forget(_without_address)
        return min(due, self.reception.serve(now), self._transmission.serve(now))

    def _claim_again(self, now: float) -> None:
        """Claim our address again after the bus was lost: another device may have taken it."""
        if self.state in {ClaimState.CLAIMING, ClaimState.CLAIMED}:
            self.reception.forget()
            self._claim.begin(now)

    def _take(self, message: can.Message, now: float) -> bool:
        group, source, destination = split(message.arbitration_id)
        data = bytes(message.data)
        if destination not in {GLOBAL, self.address}:
            return True
        if group == ADDRESS_CLAIMED and not self._claim.take(source, data, now):
            return False
        if group in self._services:
            return self._services[group](source, data)
        if group == TRANSPORT_CONTROL:
            return self._take_control(source, destination, data, now)
        if group == TRANSPORT_DATA:
            return self.reception.take_packet(source, destination, data, now)
        return self._tell(group, source, data)

    def _take_control(self, source: int, destination: int, data: bytes, now: float) -> bool:
        if destination != GLOBAL and not self._transmission.take_control(source, data, now):
            return False
        return self.reception.take_control(source, destination, data, now)

    def _take_request(self, _source: int, data: bytes) -> bool:
        if len(data) < 3:
            return False
        if int.from_bytes(data[:3], "little") == ADDRESS_CLAIMED:
            self._claim.answer()
        return True

    def _take_acknowledgement(self, source: int, data: bytes) -> bool:
        if len(data) != 8:
            return False
        group, asked_by = int.from_bytes(data[5:8], "little"), data[4]
        if data[0] in _REFUSALS and asked_by in {self.address, GLOBAL}:
            if len(self._refused) > 64:
                self._refused.clear()
            self._refused[group, source] = _REFUSALS[data[0]]
        return True

    def _tell(self, group: int, source: int, data: bytes) -> bool:
        now = self.network.now()
        refused = [take for take in self._takers.get(group, ()) if not take(source, data, now)]
        return not refused

    def _deliver(self, group: int, source: int, data: bytes) -> bool:
        return self._tell(group, source, data)

    def _say_address(self, address: int) -> None:
        can_id = join(USUAL_PRIORITY, ADDRESS_CLAIMED, address, GLOBAL)
        self.network.send_extended(can_id, self.name.pack())

    def _control(self, destination: int, data: bytes) -> None:
        self._put(_TRANSPORT_PRIORITY, TRANSPORT_CONTROL, destination, data)

    def _packet(self, destination: int, data: bytes) -> None:
        self._put(_TRANSPORT_PRIORITY, TRANSPORT_DATA, destination, data)

    def _put(self, priority: int, group: int, destination: int, data: bytes) -> None:
        self.network.send_extended(join(priority, group, self.address, destination), data)


def _without_address(transfer: str) -> AddressClaimError:
    return AddressClaimError(f"{transfer}: our address is claimed no more")
