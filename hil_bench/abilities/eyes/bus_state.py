"""The present state of a bus: senders and their rates, last values, errors of nodes."""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median
from typing import TYPE_CHECKING, Final

from hil_bench.abilities.common.identifiers import function_of
from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.silence import LATE
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.abilities.eyes.values import Reading
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.words import (
    emergency_text,
    is_error_reset,
)
from hil_bench.frame import BUS_SHIFT, bits_of, is_error_frame
from hil_bench.outside.bits import BusLoad
from hil_bench.outside.recording.channels import LoggedFrame

if TYPE_CHECKING:
    from hil_bench.canopen_device.nmt import NmtState

FIRST_FD: Final = 1 << BUS_SHIFT
"""Added to the identifier of frames of CAN FD, which are none of a node's."""

EXTENDED: Final = -1
"""Stands for all 29-bit identifiers, as CANopen has none and there are half a billion."""

_TO_ANYBODY: Final = frozenset({Service.NMT, Service.LSS})
_NAMED_BY_IDENTIFIER: Final = frozenset({Service.SDO, Service.HEARTBEAT})
_TIMES: Final = 16
_FEWEST: Final = 4
_MOST_ERRORS: Final = 8
_MOST_EVENTS: Final = 6
_HEARTBEAT: Final = 0x700
_FROM_NODE: Final = ("TPDO", "EMCY", "SDO answer", "heartbeat")
_NS_PER_S: Final = 1e9


@dataclass(slots=True)
class Stream:
    """The frames of one identifier.

    Attributes:
        frame: the last one.
        name: its service, as in ``TPDO1``.
        node_id: of the node that it comes from or goes to; None for all.
        node: the name of that node where the identifier belongs to several or to none.
        problem: what is wrong with the last one; an SDO transfer that fails is an event.
        count: how many there were.
        times: of the last ones [ns].
    """

    frame: Frame
    name: str
    node_id: int | None
    node: str = ""
    problem: str = ""
    count: int = 0
    times: deque[int] = field(default_factory=lambda: deque(maxlen=_TIMES))

    @property
    def period(self) -> float:
        """The usual time between two frames [s]; NaN before the second one."""
        if len(self.times) < 2:
            return math.nan
        return median(after - before for before, after in pairwise(self.times)) / _NS_PER_S

    @property
    def is_from_node(self) -> bool:
        """True if the node sends the frames."""
        return self.name.startswith(_FROM_NODE) and not self.frame.is_remote


@dataclass(slots=True)
class HeldValue:
    """An object that a PDO carries.

    Attributes:
        reading: its last value.
        low: its lowest value; NaN where it is no number.
        high: its highest value, likewise.
    """

    reading: Reading
    low: float = math.nan
    high: float = math.nan

    def take(self, reading: Reading) -> None:
        """Take the next value."""
        self.reading = reading
        value = reading.value
        if not isinstance(value, str) and math.isfinite(value):
            self.low, self.high = _least(self.low, value), -_least(-self.high, -value)


class BusState:
    """Keeps what a picture of the bus needs, and no more, however long it listens.

    Args:
        decoder: reads the frames.
        bitrate: of the bus [bit/s].
        speedup: how many times faster the data phase of CAN FD is.

    Attributes:
        decoder: as passed in.
        now: the time, from the first frame on [ns].
        load: of the last second [-].
        frames: how many there were; an adapter's reports of errors are none.
        streams: by identifier; those of 29 bits under `EXTENDED`, of CAN FD from `FIRST_FD` on.
        values: of each identifier of a PDO, by index and sub-index.
        errors: by node-ID, what the reported codes mean by code.
    """

    def __init__(self, decoder: Decoder, bitrate: int, speedup: float = 1.0) -> None:
        self.decoder = decoder
        self.now = 0
        self.load = 0.0
        self.frames = 0
        self.streams: dict[int, Stream] = {}
        self.values: dict[int, dict[tuple[int, int], HeldValue]] = {}
        self.errors: dict[int, dict[int, str]] = {}
        self._known = [node.node_id for node in decoder.nodes.values()]
        self._heard: set[int] = set()
        self._events: dict[tuple[object, ...], Sight] = {}
        self._meter = BusLoad(bitrate)
        self._bits = 0.0
        self._speedup = speedup
        self._reported: dict[int, NmtState | None] = {}
        self._last = self._taken = 0

    def take(self, logged: LoggedFrame) -> None:
        """Take a frame, or a report of an error."""
        frame = logged.frame
        self.now = self._taken = logged.now
        if not is_error_frame(frame):
            self.frames += 1
            self._last = self.now
        self._bits += bits_of(frame, self._speedup)
        self.load = self._meter.update(self.now, self._bits)
        own = None
        for sight in self.decoder.take(logged):
            self._note(sight)
            if sight.frame is frame:
                own = sight
        self._count(frame, own)

    def wait(self, silence: int) -> None:
        """Let time pass in which nothing came.

        Args:
            silence: how long that has been [ns].
        """
        self.now = self._taken + silence
        self.load = self._meter.update(self.now, self._bits)
        for sight in self.decoder.expire(self.now):
            self._note(sight)

    @property
    def silence(self) -> float:
        """For how long no frame has come [s]."""
        return (self.now - self._last) / _NS_PER_S

    @property
    def nodes(self) -> list[KnownNode]:
        """The nodes that are known beforehand or have sent something, by their node-ID."""
        wanted = self._heard.union(self._known)
        found = {node.node_id: node for node in self.decoder.nodes.values()}
        return [found[node_id] for node_id in sorted(wanted & found.keys())]

    @property
    def events(self) -> Iterator[Sight]:
        """The last events: NMT commands, boot-ups, EMCY, SDO transfers that failed."""
        return iter(self._events.values())

    def has_heard(self, node_id: int) -> bool:
        """Return True if a node has sent something."""
        return node_id in self._heard

    def has_reported(self, node: KnownNode) -> bool:
        """Return True if a node itself has reported its state, which else a master commanded."""
        return self._reported.get(node.node_id) is node.state

    def heartbeat_of(self, node_id: int) -> float:
        """Return the time between two heartbeats of a node [s]; NaN where it is not known."""
        stream = self.streams.get(_HEARTBEAT + node_id)
        return math.nan if stream is None or len(stream.times) <= _FEWEST else stream.period

    def heartbeat_missing(self, node_id: int) -> float:
        """Return for how long a regular heartbeat has stayed out [s]; 0 where it has not."""
        period = self.heartbeat_of(node_id)
        if not period > 0.0:
            return 0.0
        age = self.age_of(self.streams[_HEARTBEAT + node_id])
        return age if age > LATE * period else 0.0

    def age_of(self, stream: Stream) -> float:
        """Return the time since the last frame of a stream [s]."""
        return (self.now - stream.times[-1]) / _NS_PER_S

    def _count(self, frame: Frame, sight: Sight | None) -> None:
        key = EXTENDED if frame.is_extended else frame.can_id
        if frame.fd and not frame.is_extended:
            key = FIRST_FD + frame.can_id
        stream = self.streams.get(key)
        if stream is None:
            name, node_id = function_of(frame.can_id)
            if frame.fd or frame.is_extended:
                name, node_id = "29-bit" if frame.is_extended else "CAN FD", None
            stream = self.streams[key] = Stream(frame, name, node_id)
        stream.frame = frame
        stream.count += 1
        stream.times.append(self.now)
        if sight is not None and sight.service not in _TO_ANYBODY and not frame.is_extended:
            if sight.service not in _NAMED_BY_IDENTIFIER:
                stream.name = sight.name
            if sight.service is not Service.SDO:
                stream.problem = sight.problem
            stream.node_id, stream.node = sight.node_id, sight.node
        if stream.is_from_node and stream.node_id is not None:
            self._heard.add(stream.node_id)

    def _note(self, sight: Sight) -> None:
        if sight.service is Service.PDO:
            self._hold(sight)
        elif sight.name in {"EMCY", "NMT", "boot-up"} or (
            sight.service is Service.SDO and sight.problem
        ):
            self._keep(sight)
        if sight.node_id is not None:
            if sight.service is Service.HEARTBEAT and not (sight.problem or sight.frame.is_remote):
                self._reported[sight.node_id] = self.decoder.nodes[0, sight.node_id].state
            if sight.name == "EMCY":
                self._hear_emcy(sight.node_id, sight)
            elif sight.name == "boot-up":
                self.errors.pop(sight.node_id, None)

    def _hold(self, sight: Sight) -> None:
        """Hold the values of a PDO; what is not mapped any more goes."""
        if not sight.readings:
            return
        before = self.values.get(sight.frame.can_id, {})
        held = {}
        for reading in sight.readings:
            place = reading.object_index, reading.subindex
            held[place] = before.get(place) or HeldValue(reading)
            held[place].take(reading)
        self.values[sight.frame.can_id] = held

    def _keep(self, sight: Sight) -> None:
        """Keep an event; one that comes again takes the place of the one before."""
        what = sight.words if sight.transfer is None else sight.transfer.place
        key = sight.name, sight.node_id, what, sight.problem
        self._events.pop(key, None)
        self._events[key] = sight
        if len(self._events) > _MOST_EVENTS:
            del self._events[next(iter(self._events))]

    def _hear_emcy(self, node_id: int, sight: Sight) -> None:
        """Follow the errors of a node: an error reset with an empty error register ends all."""
        code = sight.emcy_code
        if code is None:
            return
        errors = self.errors.setdefault(node_id, {})
        if not is_error_reset(code):
            errors.pop(code, None)
            errors[code] = emergency_text(code)
            if len(errors) > _MOST_ERRORS:
                del errors[next(iter(errors))]
        elif sight.frame.data[2] == 0:  # the error register
            errors.clear()


def _least(before: float, value: float) -> float:
    return value if math.isnan(before) else min(before, value)
