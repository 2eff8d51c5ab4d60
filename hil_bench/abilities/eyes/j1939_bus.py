"""Reads the frames of buses on which J1939 is spoken: who sends what, long messages as one."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from hil_bench.abilities.eyes.j1939 import content_of, group_name
from hil_bench.abilities.eyes.j1939_transfers import FastPackets, LongMessage, LongMessages
from hil_bench.abilities.eyes.known_ecu import KnownEcu, KnownSignal
from hil_bench.abilities.eyes.sight import J1939Message, Service, Sight
from hil_bench.abilities.j1939.protocol.signals import (
    ADDRESS_CLAIMED,
    COMMANDED_ADDRESS,
    GLOBAL,
    NAME_BYTES,
    NOT_AVAILABLE,
    NULL,
    REQUEST,
    TRANSPORT_CONNECTION,
    TRANSPORT_DATA,
    Signal,
    split,
)
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import LoggedFrame

_MS: Final = 1e-6
_PROOF: Final = 10
_SHOWN: Final = 64
"""Bytes of a long message that are shown."""

_ASSIGNED: Final = range(0xFE00, 0xFF00)
"""Parameter groups of eight bytes to all that SAE has assigned, with or without a name here."""
_REQUEST_OF_CLAIMS: Final = ADDRESS_CLAIMED.to_bytes(3, "little")
_CLAIMED_AFTER: Final = 300_000_000
"""Time in which a request for claims is answered [ns]."""

Place = tuple[int, int]
"""Bus and address."""


class J1939Reader:
    """Follows who has which address, and which long messages are under way.

    A bus speaks J1939 if known devices are on it, or an address claim, a request for claims or the
    announcement of a long message was heard, or ten frames of parameter groups that the standard
    names; a lone 29-bit frame proves nothing.

    Args:
        known: the devices that ought to be there.
    """

    def __init__(self, known: Iterable[KnownEcu] = ()) -> None:
        known = tuple(known)
        self._by_identity = {(each.bus, each.identity): each for each in known}
        self._at: dict[Place, KnownEcu] = {(each.bus, each.address): each for each in known}
        self._buses = {each.bus for each in known}
        self._named: dict[int, int] = {}
        self._long, self._fast = LongMessages(), FastPackets()
        self._asked: dict[Place, int] = {}
        self._last: dict[tuple[int, int, int], Frame] = {}

    @property
    def names(self) -> list[str]:
        """Names of the known devices."""
        return [each.name for each in self._by_identity.values()]

    def take(self, logged: LoggedFrame) -> list[Sight] | None:
        """Decode a frame; return nothing in the middle of a transfer, None if it is no J1939."""
        frame = logged.frame
        _, group, source, destination = split(frame.can_id)
        way, bus, now = (source, destination), frame.bus, logged.now
        if frame.is_remote:
            return None
        is_part, ended = False, list[LongMessage]()
        if group == TRANSPORT_CONNECTION:
            is_part, ended = self._long.take_control(bus, way, frame.data, now)
        elif group == TRANSPORT_DATA:
            is_part, ended = self._long.take_packet(bus, way, frame.data, now)
        elif group == ADDRESS_CLAIMED and len(frame.data) == NAME_BYTES:
            self._buses.add(bus)
            self._move(bus, source, frame.data)
        elif group == REQUEST and frame.data == _REQUEST_OF_CLAIMS:
            self._buses.add(bus)
        if is_part:
            self._buses.add(bus)
        if bus not in self._buses and not self._is_proof(frame, group):
            return None
        for each in ended:
            self._last[each.key] = frame
        sights = [self._of_long(each, now) for each in ended]
        if is_part:
            self._last[bus, source, destination] = frame
            self._last[bus, destination, source] = frame
            return sights
        return [*sights, self._of_frame(logged, group, way)]

    def _is_proof(self, frame: Frame, group: int) -> bool:
        """Return True if enough frames of named parameter groups show that J1939 is spoken.

        Any small identifier of 29 bits is one of group 0, so that shows nothing.
        """
        is_named = group and (group_name(group) or group in _ASSIGNED)
        if len(frame.data) == NAME_BYTES and is_named:
            self._named[frame.bus] = self._named.get(frame.bus, 0) + 1
        if self._named.get(frame.bus, 0) >= _PROOF:
            self._buses.add(frame.bus)
        return frame.bus in self._buses

    def expire(self, now: int) -> list[Sight]:
        """Return the long messages that nobody continues."""
        return [self._of_long(each, now) for each in self._long.expire(now)]

    def finish(self) -> list[Sight]:
        """Return the long messages that the end has interrupted."""
        return [self._of_long(each, each.last) for each in self._long.finish()]

    def label(self, bus: int, address: int) -> str:
        """Return the name of the device at an address; "address 5" where it is unknown."""
        found = self._at.get((bus, address))
        if found is not None:
            return found.name
        return "no address" if address == NULL else f"address {address}"

    def _move(self, bus: int, address: int, data: bytes) -> None:
        """Follow a device to the address that it claims."""
        ecu = self._by_identity.get((bus, int.from_bytes(data, "little")))
        if ecu is None:
            return
        for place in [place for place, each in self._at.items() if each is ecu]:
            del self._at[place]
        if address != NULL:
            self._at[bus, address] = ecu

    def _of_frame(self, logged: LoggedFrame, group: int, way: tuple[int, int]) -> Sight:
        frame, (source, destination) = logged.frame, way
        part = self._fast.part_of((frame.bus, *way), group, frame.data, logged.now)
        if part is not None:
            words = f"frame {part[0]} of {part[1]} of a fast packet {_digits(frame.data)}"
            head = logged.now, frame, Service.J1939, f"PGN {group}", self.label(frame.bus, source)
            return Sight(*head, said=words)
        receiver = self._receiver(frame.bus, destination)
        signals = self._signals(frame.bus, source, group)
        shown = tuple((each.name, each.shown(frame.data)) for each in signals)
        message = J1939Message(group, source, destination, frame.data, logged.now, receiver, shown)
        return self._sight(logged.now, frame, message, _Words(message, signals))

    def _of_long(self, found: LongMessage, now: int) -> Sight:
        bus, source, destination = found.key
        data = None if found.problem or not found.is_whole else found.data
        receiver = self._receiver(bus, destination)
        message = J1939Message(
            found.group, source, destination, data, found.begin, receiver, culprit=found.culprit
        )
        by = "BAM" if found.is_to_all else "RTS and CTS"
        lasted = (found.last - found.begin) * _MS
        words = ", ".join(filter(None, (_head(message), f"{found.size} bytes by {by}")))
        if data is not None:
            signals = self._signals(bus, source, found.group)
            words = _joined(f"{words} in {lasted:.4g} ms", _content(message, signals))
        frame = self._last.pop(found.key)
        return self._sight(now, frame, message, words, found.problem or found.pace)

    def _sight(
        self,
        now: int,
        frame: Frame,
        message: J1939Message,
        said: str | Callable[[], str],
        problem: str = "",
    ) -> Sight:
        if message.group == ADDRESS_CLAIMED:
            message = message._replace(is_answer=self._is_asked(frame.bus, message.source, now))
        elif message.group == COMMANDED_ADDRESS:
            self._asked[frame.bus, GLOBAL] = now
        elif message.group == REQUEST and (message.data or b"")[:3] == _REQUEST_OF_CLAIMS:
            self._asked[frame.bus, message.destination] = now
        return Sight(
            now,
            frame,
            Service.J1939,
            f"PGN {message.group}",
            self._sender(frame.bus, message),
            said=said,
            problem=problem,
            message=message,
        )

    def _is_asked(self, bus: int, address: int, now: int) -> bool:
        """Return True if an address, or all, were asked for claims just before."""
        asked = [self._asked.get((bus, each)) for each in (address, GLOBAL)]
        return any(each is not None and now - each <= _CLAIMED_AFTER for each in asked)

    def _sender(self, bus: int, message: J1939Message) -> str:
        """Return the name of the sender; a device that claims says who it is."""
        if message.group == ADDRESS_CLAIMED and message.data is not None:
            known = self._by_identity.get((bus, int.from_bytes(message.data, "little")))
            if known is not None:
                return known.name
        return self.label(bus, message.source)

    def _receiver(self, bus: int, destination: int) -> str:
        return "" if destination == GLOBAL else self.label(bus, destination)

    def _signals(self, bus: int, source: int, group: int) -> tuple[KnownSignal, ...]:
        """Return the signals of a message: those of the bench, or else those of the standard."""
        ecu = self._at.get((bus, source))
        found = ecu.signals.get(group, ()) if ecu is not None else ()
        return found or SPNS.get(group, ())


@dataclass(frozen=True, slots=True)
class _Words:
    """Puts the words for a message of one frame together, once somebody reads them.

    Attributes:
        message: the message.
        signals: those known of it.
    """

    message: J1939Message
    signals: Sequence[KnownSignal]

    def __call__(self) -> str:
        """Return the words."""
        return _joined(_head(self.message), _content(self.message, self.signals))


def _content(message: J1939Message, signals: Sequence[KnownSignal]) -> str:
    data = message.data or b""
    text = ", ".join(_values(message.group, data, signals)) or content_of(message.group, data)
    return text or _digits(data)


def _values(group: int, data: bytes, signals: Sequence[KnownSignal]) -> Iterator[str]:
    """Yield the values of a message; of the standard's signals those that the sender has."""
    is_standard = signals is SPNS.get(group)
    for signal in signals:
        indicator = signal.shown(data)
        if not (is_standard and indicator == NOT_AVAILABLE):
            yield signal.words(data, indicator)


def _joined(head: str, content: str) -> str:
    """Join the title of a message and its content; digits go without a colon."""
    return f"{head}{' ' if content.startswith('[') else ': '}{content}" if head else content


def _digits(data: bytes) -> str:
    """Return bytes in hexadecimal digits, of a long message the first."""
    more = f" and {len(data) - _SHOWN} more" if len(data) > _SHOWN else ""
    return f"[{data[:_SHOWN].hex(' ').upper()}{more}]"


def _head(message: J1939Message) -> str:
    to = f"to {message.receiver}" if message.receiver else ""
    return " ".join(part for part in (group_name(message.group), to) if part)


# Signals that SAE J1939-71 defines, for reading a bus of which nothing is known.


def _byte(place: int, resolution: float, offset: float = 0.0) -> Signal:
    """Return a signal of one byte, counted from 1 as the standard does."""
    return Signal(8 * (place - 1), 8, resolution, offset)


def _word(place: int, resolution: float, offset: float = 0.0) -> Signal:
    """Return a signal of two bytes, the first counted from 1."""
    return Signal(8 * (place - 1), 16, resolution, offset)


def _spn(number: int, name: str, signal: Signal, unit: str) -> KnownSignal:
    return KnownSignal(f"{name} (SPN {number})", signal, unit)


_RPM: Final = 0.125
_KELVIN: Final = 0.03125
_ZERO: Final = -273.0

SPNS: Final[Mapping[int, tuple[KnownSignal, ...]]] = MappingProxyType(
    {
        0xF001: (_spn(521, "brake pedal position", _byte(2, 0.4), "%"),),
        0xF002: (
            _spn(191, "output shaft speed", _word(2, _RPM), "rpm"),
            _spn(161, "input shaft speed", _word(6, _RPM), "rpm"),
        ),
        0xF003: (
            _spn(91, "accelerator pedal position 1", _byte(2, 0.4), "%"),
            _spn(92, "engine load", _byte(3, 1.0), "%"),
        ),
        0xF004: (
            _spn(512, "demanded torque", _byte(2, 1.0, -125.0), "%"),
            _spn(513, "actual torque", _byte(3, 1.0, -125.0), "%"),
            _spn(190, "engine speed", _word(4, _RPM), "rpm"),
        ),
        0xFEE5: (_spn(247, "engine hours", Signal(0, 32, 0.05), "h"),),
        0xFEEE: (
            _spn(110, "coolant temperature", _byte(1, 1.0, -40.0), "°C"),
            _spn(174, "fuel temperature", _byte(2, 1.0, -40.0), "°C"),
            _spn(175, "oil temperature", _word(3, _KELVIN, _ZERO), "°C"),
        ),
        0xFEEF: (
            _spn(94, "fuel delivery pressure", _byte(1, 4.0), "kPa"),
            _spn(98, "oil level", _byte(3, 0.4), "%"),
            _spn(100, "oil pressure", _byte(4, 4.0), "kPa"),
        ),
        0xFEF1: (_spn(84, "wheel-based speed", _word(2, 1 / 256), "km/h"),),
        0xFEF2: (
            _spn(183, "fuel rate", _word(1, 0.05), "l/h"),
            _spn(51, "throttle position", _byte(7, 0.4), "%"),
        ),
        0xFEF5: (
            _spn(108, "barometric pressure", _byte(1, 0.5), "kPa"),
            _spn(170, "cab temperature", _word(2, _KELVIN, _ZERO), "°C"),
            _spn(171, "ambient temperature", _word(4, _KELVIN, _ZERO), "°C"),
        ),
        0xFEF6: (
            _spn(102, "boost pressure", _byte(2, 2.0), "kPa"),
            _spn(105, "intake manifold temperature", _byte(3, 1.0, -40.0), "°C"),
            _spn(173, "exhaust temperature", _word(6, _KELVIN, _ZERO), "°C"),
        ),
        0xFEF7: (
            _spn(167, "charging voltage", _word(3, 0.05), "V"),
            _spn(168, "battery voltage", _word(5, 0.05), "V"),
            _spn(158, "keyswitch voltage", _word(7, 0.05), "V"),
        ),
        0xFEFC: (_spn(96, "fuel level", _byte(2, 0.4), "%"),),
    }
)
"""The signals of each parameter group."""
