"""Samples of a machine: decoded from frames, with their clock and its punctuality."""

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pkgutil import resolve_name
from typing import NamedTuple

import can

from hil_bench.bench.configuration import BenchConfig, NodeConfig
from hil_bench.bench.virtual_bench import VirtualBench
from hil_drivers import DriverError, Network, PositionSensor, PressureSensor, ProportionalValve
from hil_drivers.device import Device, Input

# The lateness of a PDO against its usual time.
#
# A computer or a bus that is too slow for a bench holds commands up, too, and by as much. A PDO
# that is sent when its value changes comes at any time, and is never late.

_KEPT = 256
_FEWEST = 8
_REFRESHED = 16
"""After so many times the usual one is found anew."""
_PROMPT = 5e-3
"""A PDO of which a quarter comes within this time after SYNC answers it [s]."""
_TOLERANCE, _SHARE = 2e-3, 0.2
"""Intervals are alike within so many seconds, or so much of the median."""
_MANY = 0.4
"""Share of intervals that are alike if there is a usual one."""


class _Times:
    """The last times of one kind, and the usual one."""

    def __init__(self, find_usual: Callable[[Sequence[float]], float | None]) -> None:
        self._find_usual = find_usual
        self._times: deque[float] = deque(maxlen=_KEPT)
        self._usual: float | None = None
        self._count = 0

    def take(self, time: float) -> float | None:
        """Take the next time [s]; return how much longer than usual it is, None without a usual."""
        self._times.append(time)
        self._count += 1
        if self._count == _FEWEST or not self._count % _REFRESHED:
            self._usual = self._find_usual(sorted(self._times))
        return None if self._usual is None else max(time - self._usual, 0.0)


class PdoPunctuality:
    """The lateness of one PDO after the frame before and after the SYNC that it may answer."""

    def __init__(self) -> None:
        self._came_at: float | None = None
        self._unanswered: float | None = None
        self._intervals = _Times(usual_interval)
        self._answers = _Times(usual_answer)

    def synchronise(self, time: float) -> None:
        """Take a SYNC [s]."""
        if self._unanswered is None:
            self._unanswered = time

    def take(self, time: float) -> float:
        """Take a frame of the PDO at a time [s]; return how late it is [s], 0 if that is unknown.

        A PDO that answers SYNC is not late if SYNC was.
        """
        found = []
        if self._came_at is not None:
            found.append(self._intervals.take(time - self._came_at))
        if self._unanswered is not None:
            found.append(self._answers.take(time - self._unanswered))
        self._came_at, self._unanswered = time, None
        return min((late for late in found if late is not None), default=0.0)


def usual_interval(times: Sequence[float]) -> float | None:
    """Return the interval [s] that many of the sorted ones have; None where they differ."""
    usual = times[len(times) // 2]
    tolerance = max(_TOLERANCE, _SHARE * usual)
    alike = sum(abs(time - usual) <= tolerance for time in times)
    return usual if alike >= _MANY * len(times) else None


def usual_answer(times: Sequence[float]) -> float | None:
    """Return the time after SYNC [s] of an answer; None where too few of the sorted ones answer."""
    quarter = times[len(times) // 4]
    return quarter if quarter <= _PROMPT else None


# When a value that comes in a PDO was measured, as far as the frames of a bus show.

_SYNC = 0x080
_EVIDENCE = 8
"""Frames of a PDO by which it is judged."""
_UNKNOWN_PERIOD = 0.01
"""SYNC period before the second SYNC [s]."""
_TRANSFER = 2e-3
"""What a device and its bus may take between measuring and sending, or to act on a command [s]."""
_CYCLE = 1e-3
"""How much earlier a command may act than the twin, which acts in ticks of its own, thinks [s]."""


class SampleTime(NamedTuple):
    """When a value was measured.

    Attributes:
        earliest: not before this [s].
        likely: the SYNC's time if the PDO follows SYNC, that of the frame if not [s].
        frame: the time of its frame [s].
        latest: up to this time of the twin, whose ticks are not those of the device [s].
        lateness: how much later than usual the frame came [s].
    """

    earliest: float
    likely: float
    frame: float
    latest: float
    lateness: float


class SampleClock:
    """Tells PDOs that follow SYNC from those that come by themselves.

    A device measures at SYNC, and its synchronous PDO waits for the bus among those of all the
    others (CiA 301, 7.5.2.16). Whether a PDO is synchronous may have been set before anybody
    listened. So it counts as synchronous while its last frames say nothing against it: each the
    first of its kind after a SYNC, and at once, or within half of the SYNC's period where it is
    known to be synchronous. If that is wrong, the time of the frame is still among those that are
    looked at.

    Args:
        identifiers: of the PDOs that are looked at.
        is_synchronous: whether a PDO is known to be.
    """

    def __init__(self, identifiers: Iterable[int], is_synchronous: Callable[[int], bool]) -> None:
        self._is_synchronous = is_synchronous
        self._synced_at: float | None = None
        self._period = _UNKNOWN_PERIOD
        self._since_sync: set[int] = set()
        self._in_step = {pdo: deque[bool](maxlen=_EVIDENCE) for pdo in identifiers}
        self._punctuality = {pdo: PdoPunctuality() for pdo in self._in_step}

    def take(self, message: can.Message, time: float) -> SampleTime:
        """Take a frame, and return when its values were measured.

        Args:
            message: the frame.
            time: when it was on the bus [s].
        """
        identifier = message.arbitration_id
        if identifier == _SYNC and not message.is_extended_id:
            self._synchronise(time)
        if identifier not in self._in_step or message.is_extended_id or message.is_remote_frame:
            return _sample_time(time, time, 0.0)
        lateness = self._punctuality[identifier].take(time)
        synced_at = self._synced_at
        if synced_at is not None and self._follows_sync(identifier, time - synced_at):
            return _sample_time(synced_at, time, lateness)
        return _sample_time(time, time, lateness)

    def _synchronise(self, time: float) -> None:
        if self._synced_at is not None:
            self._period = time - self._synced_at
        self._synced_at = time
        self._since_sync.clear()
        for pdo in self._punctuality.values():
            pdo.synchronise(time)

    def _follows_sync(self, identifier: int, delay: float) -> bool:
        is_first = identifier not in self._since_sync
        self._since_sync.add(identifier)
        longest = 0.5 * self._period
        if not self._is_synchronous(identifier):
            longest = min(longest, _TRANSFER)
        evidence = self._in_step[identifier]
        evidence.append(is_first and delay <= longest)
        return all(evidence)


def _sample_time(likely: float, frame: float, lateness: float) -> SampleTime:
    earliest = min(likely, frame - _TRANSFER)
    return SampleTime(earliest, likely, frame, frame + _CYCLE, lateness)


# Decoding of a bus' devices, in SI units, from their TPDOs alone.

STATUS_WORD = "status_word"
"""The quantity that a valve's status word is."""


class Reading(NamedTuple):
    """One quantity of one axis as a device reports it.

    Attributes:
        axis: its name.
        quantity: of the plant, or `STATUS_WORD`.
        name: of the device.
        node_id: of the device.
        device: the driver that decodes it.
        source: the PDO that brings it.
        value: what it says now, in SI; of the spool, in full openings.
    """

    axis: str
    quantity: str
    name: str
    node_id: int
    device: Device
    source: Input
    value: Callable[[], float]

    def read(self) -> float:
        """Return the value; NaN while the device has none that is valid."""
        try:
            value = self.value()
        except DriverError:
            return math.nan
        return value if math.isfinite(value) else math.nan


class OverheardDrivers:
    """The drivers of a bench's devices, fed with frames that somebody overheard.

    How a device maps and scales its values is taken from the configuration: the drivers ask a
    virtual bench of the same configuration for it, so nothing is sent to the machine.

    Args:
        config: the bench.

    Attributes:
        readings: all quantities that can be decoded.
    """

    def __init__(self, config: BenchConfig) -> None:
        self._time = 0.0
        with VirtualBench(config, recorded_time=0.1, logged_frames=1) as bench:
            # Bench time stands still once all is set up; from then on, the frames' time counts.
            self._network = Network(bench.bus, clock=lambda: bench.now() + self._time)
            self.readings = [
                reading for node in config.nodes if node.axis for reading in self._readings(node)
            ]
        self._seen = dict.fromkeys(self.readings, -math.inf)

    def take(self, message: can.Message, time: float) -> list[Reading]:
        """Take a frame of the bus and return which quantities it brought.

        Args:
            message: the frame.
            time: when it was on the bus, from the first one [s].
        """
        self._time = time
        self._network.deliver(message)
        fresh = []
        for reading in self.readings:
            received_at = reading.source.pdo.received_at
            if received_at > self._seen[reading]:
                self._seen[reading] = received_at
                if math.isfinite(reading.device.received_at):  # its other PDOs have come, too
                    fresh.append(reading)
        return fresh

    def _readings(self, node: NodeConfig) -> Iterator[Reading]:
        watched = node.kind.watched(node)
        if not watched or node.kind.driver is None:
            return
        # A value may come on two PDOs of different age, the second with its status.
        device: PressureSensor | PositionSensor | ProportionalValve = resolve_name(
            node.kind.driver
        )(self._network, node.node_id, node.eds, max_age=math.inf)
        device.setup(transmission_type=254)
        device.expect_protection(node.protected_tpdos)
        axis = str(node.axis)
        if isinstance(device, ProportionalValve):
            word = device.status
            yield Reading(
                *(axis, STATUS_WORD, node.name, node.node_id, device, word),
                lambda: word.signal.decode(word.pdo.data),
            )
        for quantity, attribute in watched.items():
            yield Reading(
                *(axis, quantity, node.name, node.node_id, device, device.primary),
                partial(getattr, device, attribute),
            )
