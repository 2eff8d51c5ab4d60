"""A device on J1939."""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from hil_bench.abilities.j1939.protocol import signals, transmission
from hil_bench.abilities.j1939.protocol.address_claim import AddressClaim, ClaimState
from hil_bench.abilities.j1939.protocol.diagnostics import Diagnostics, Lamp, TroubleCode
from hil_bench.abilities.j1939.protocol.reception import Deliver, Reception
from hil_bench.canopen_device.agenda import NEVER
from hil_bench.canopen_device.frame import Emit, Frame

# The transport protocol of SAE J1939-21: 9 to 1785 bytes, to one (RTS/CTS) or to all (BAM).
#
# What breaks the rules ends its session, with an abort where it has one partner.


class Transport:
    """The sessions of one device.

    Args:
        put_control: sends TP.CM.
        put_data: sends TP.DT.
        deliver: takes the messages that have come.
    """

    def __init__(
        self, put_control: transmission.Put, put_data: transmission.Put, deliver: Deliver
    ) -> None:
        line = transmission.Line(put_control)
        self._reception = Reception(line, deliver)
        self._transmission = transmission.Transmission(line, put_data)

    @property
    def due(self) -> int:
        """When `serve` has something to do [ns]; it may be earlier than need be."""
        return min(self._reception.due, self._transmission.due)

    def reset(self) -> None:
        """Forget all sessions."""
        self._reception.reset()
        self._transmission.reset()

    def send(self, group: int, data: bytes, destination: int, now: int) -> bool:
        """Send a message of 9 to 1785 bytes; False where it has no room to wait in."""
        return self._transmission.send(group, data, destination, now)

    def take_control(self, source: int, destination: int, data: bytes, now: int) -> None:
        """Take a TP.CM message."""
        if len(data) != 8 or source >= signals.NULL:
            return
        group = int.from_bytes(data[5:8], "little")
        control = data[0]
        if destination == signals.GLOBAL:
            if control == transmission.Control.BAM:
                self._reception.take_bam(source, group, data, now)
        elif control == transmission.Control.RTS:
            self._reception.take_rts(source, group, data, now)
        elif control == transmission.Control.CTS:
            self._transmission.take_cts(source, group, data, now)
        elif control == transmission.Control.END:
            self._transmission.take_end(source, group, data, now)
        elif control == transmission.Control.ABORT:
            self._reception.end(source, group)
            self._transmission.end(source, group, now)

    def take_data(self, source: int, destination: int, data: bytes, now: int) -> None:
        """Take a TP.DT message."""
        self._reception.take_data(source, destination, data, now)

    def serve(self, now: int) -> None:
        """End the sessions whose time is over, and send packets to all that are due."""
        self._reception.serve(now)
        self._transmission.serve(now)


USUAL_PRIORITY: Final = 6
TRANSPORT_PRIORITY: Final = 7

_FRAME_BYTES: Final = 8
_VIOLATION_SPN: Final = 2000
_VIOLATION_FMI: Final = 31
_VIOLATION_PAUSE: Final = 5_000_000_000

Take = Callable[[int, bytes, int], None]
"""Takes a message of a parameter group: source address, data, time [ns]."""

Make = Callable[[], bytes]
"""Makes the data of a parameter group."""


class Answer(IntEnum):
    """The answer of an acknowledgement."""

    DONE = 0
    REFUSED = 1


@dataclass(slots=True)
class _Provided:
    """A parameter group that an ECU sends.

    Attributes:
        group: its PGN.
        make: makes its data.
        period: between two [ns]; 0 for on request alone.
        priority: of its frames.
        due: when the next one is sent [ns].
    """

    group: int
    make: Make
    period: int
    priority: int
    due: int = NEVER


class Ecu:
    """One ECU on a bus.

    Args:
        name: its NAME.
        address: that it claims first, 0 to 253.

    Attributes:
        claim: its address.
        transport: its long messages.
        diagnostics: its trouble codes.
        false_address: a source address that it uses in place of its own, as if set up wrongly;
            None for its own.
    """

    def __init__(self, name: signals.Name, address: int) -> None:
        self.name = name
        self.claim = AddressClaim(name, address, self._send_claim)
        self.transport = Transport(self._put_control, self._put_data, self._take_long)
        self.diagnostics = Diagnostics()
        self.false_address: int | None = None
        self._out: deque[Frame] = deque()
        self._now = 0
        self._answered_violation = -_VIOLATION_PAUSE
        self._provided: dict[int, _Provided] = {}
        self._takers: dict[int, Take] = {}
        self._cycle = NEVER
        self._services: Mapping[int, Callable[[int, int, bytes], None]] = {
            signals.REQUEST: self._take_request,
            signals.ADDRESS_CLAIMED: self._take_claim,
            signals.TRANSPORT_CONNECTION: self._take_connection,
            signals.TRANSPORT_DATA: self._take_packet,
        }
        self.provide(signals.DM1, self.diagnostics.dm1)
        self.provide(signals.DM2, self.diagnostics.dm2)
        self.take(signals.COMMANDED_ADDRESS, self._obey_command)

    @property
    def address(self) -> int:
        """The address that it has or claims; `NULL` for none."""
        return self.claim.address

    @property
    def state(self) -> ClaimState:
        """The state of the address claim."""
        return self.claim.state

    def start(self, now: int) -> None:
        """Power on at `now` [ns]: claim the address, then begin with the cyclic groups."""
        self._now = now
        self.transport.reset()
        self.diagnostics.reset()
        self.claim.start(now)
        self._schedule(now)

    def rejoin(self, now: int) -> None:
        """Take part again at `now` [ns] after bus-off: nobody knows who has its address by now."""
        self._now = now
        self.transport.reset()
        self._out.clear()
        self.claim.resume(now)

    def stop(self) -> None:
        """Power off: forget everything, and say nothing."""
        self.claim.stop()
        self.transport.reset()
        self._out.clear()

    def provide(
        self, group: int, make: Make, *, period: int = 0, priority: int = USUAL_PRIORITY
    ) -> None:
        """Send a parameter group, each `period` [ns] and on request."""
        self._provided[group] = _Provided(group, make, period, priority)

    def take(self, group: int, take: Take) -> None:
        """Have the messages of a parameter group taken, whoever sends them."""
        self._takers[group] = take

    def send(
        self,
        group: int,
        data: bytes,
        destination: int = signals.GLOBAL,
        priority: int = USUAL_PRIORITY,
    ) -> bool:
        """Send a message of up to 1785 bytes; False without an address or room to wait in.

        Raises:
            ValueError: it is longer.
        """
        if len(data) > transmission.MOST_BYTES:
            raise ValueError(f"{len(data)} bytes; {transmission.MOST_BYTES} can be sent")
        if self.claim.state is not ClaimState.CLAIMED:
            return False
        if len(data) > _FRAME_BYTES:
            return self.transport.send(group, data, destination, self._now)
        self._put(priority, group, destination, data)
        return True

    def request(self, group: int, destination: int = signals.GLOBAL) -> None:
        """Ask for a parameter group; also without an address."""
        self._put(USUAL_PRIORITY, signals.REQUEST, destination, group.to_bytes(3, "little"))

    def receive(self, frame: Frame, now: int) -> None:
        """Take a frame from the bus."""
        self._now = now
        if frame.is_remote or self.claim.state is ClaimState.OFF:
            return
        _, group, source, destination = signals.split(frame.can_id)
        if destination not in {signals.GLOBAL, self.claim.address}:
            return
        if (
            source == self.claim.address
            and source < signals.NULL
            and group != signals.ADDRESS_CLAIMED
        ):
            self._answer_violation(now)
        service = self._services.get(group)
        if service is not None:
            service(source, destination, frame.data)
        elif group in self._takers:
            self._takers[group](source, frame.data, now)

    def serve(self, now: int, emit: Emit) -> None:
        """Send what is due."""
        self._now = now
        if self.claim.state is ClaimState.OFF:
            return
        self.claim.serve(now)
        self.transport.serve(now)
        if self.claim.state is ClaimState.CLAIMED:
            if now >= self.diagnostics.due:
                self.diagnostics.expire(now)
                self.send(signals.DM1, self.diagnostics.dm1())
            if now >= self._cycle:
                self._send_cyclic(now)
        while self._out:
            emit(self._out.popleft())

    def begin_trouble(self, spn: int, fmi: int, lamp: Lamp | None = Lamp.WARNING) -> None:
        """Make a trouble code active."""
        self.diagnostics.begin(TroubleCode(spn, fmi), lamp, self._now)

    def end_trouble(self, spn: int, fmi: int) -> None:
        """Let a trouble code be active no more."""
        self.diagnostics.end(TroubleCode(spn, fmi), self._now)

    def _schedule(self, now: int) -> None:
        for each in self._provided.values():
            each.due = now if each.period else NEVER
        self._cycle = min((each.due for each in self._provided.values()), default=NEVER)

    def _send_cyclic(self, now: int) -> None:
        for each in self._provided.values():
            if now >= each.due:
                self.send(each.group, each.make(), priority=each.priority)
                late = (now - each.due) // each.period
                each.due += (late + 1) * each.period
        self._cycle = min(each.due for each in self._provided.values())

    def _take_request(self, source: int, destination: int, data: bytes) -> None:
        if len(data) < 3:
            return
        group = int.from_bytes(data[:3], "little")
        if group == signals.ADDRESS_CLAIMED:
            self.claim.answer(self._now)
            return
        if self.claim.state is not ClaimState.CLAIMED:
            return
        if group == signals.DM3:
            self.diagnostics.clear_previous()
            self._acknowledge(Answer.DONE, group, source, destination)
        elif group in self._provided:
            made = self._provided[group]
            is_alone = destination != signals.GLOBAL and source < signals.NULL
            is_single = signals.is_to_all(group)
            data = made.make()
            to = (
                source
                if is_alone and (not is_single or len(data) > _FRAME_BYTES)
                else signals.GLOBAL
            )
            self.send(group, data, to, made.priority)
        else:
            self._acknowledge(Answer.REFUSED, group, source, destination)

    def _acknowledge(self, answer: Answer, group: int, source: int, destination: int) -> None:
        """Answer a request that was sent to this device alone; to all, as J1939-21 asks."""
        if destination == signals.GLOBAL or group > signals.HIGHEST_GROUP:
            return
        body = bytes((answer, 0xFF, 0xFF, 0xFF, source)) + group.to_bytes(3, "little")
        self._put(USUAL_PRIORITY, signals.ACKNOWLEDGEMENT, signals.GLOBAL, body)

    def _take_claim(self, source: int, _destination: int, data: bytes) -> None:
        self.claim.take(source, data, self._now)

    def _take_connection(self, source: int, destination: int, data: bytes) -> None:
        if self.claim.state is ClaimState.CLAIMED or destination == signals.GLOBAL:
            self.transport.take_control(source, destination, data, self._now)

    def _take_packet(self, source: int, destination: int, data: bytes) -> None:
        self.transport.take_data(source, destination, data, self._now)

    def _take_long(self, group: int, source: int, data: bytes) -> None:
        if group in self._takers:
            self._takers[group](source, data, self._now)

    def _obey_command(self, _source: int, data: bytes, now: int) -> None:
        self.claim.command(data, now)

    def _answer_violation(self, now: int) -> None:
        """Claim again where another one uses this address, and say so by a code (J1939-81)."""
        if now - self._answered_violation < _VIOLATION_PAUSE:
            return
        self._answered_violation = now
        self._send_claim(self.claim.address)
        code = _VIOLATION_SPN + self.claim.address, _VIOLATION_FMI
        self.begin_trouble(*code, None)
        self.end_trouble(*code)

    def _send_claim(self, address: int) -> None:
        self._out.append(Frame(_claim_id(address), bytes(self.name), is_extended=True))

    def _put_control(self, destination: int, data: bytes) -> None:
        self._put(TRANSPORT_PRIORITY, signals.TRANSPORT_CONNECTION, destination, data)

    def _put_data(self, destination: int, data: bytes) -> None:
        self._put(TRANSPORT_PRIORITY, signals.TRANSPORT_DATA, destination, data)

    def _put(self, priority: int, group: int, destination: int, data: bytes) -> None:
        source = self.claim.address if self.false_address is None else self.false_address
        can_id = signals.join(priority, group, source, destination)
        self._out.append(Frame(can_id, data, is_extended=True))


def _claim_id(address: int) -> int:
    return signals.join(USUAL_PRIORITY, signals.ADDRESS_CLAIMED, address)
