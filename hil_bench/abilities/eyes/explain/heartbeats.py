"""Heartbeats that stay out, and who noticed."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from statistics import median

from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.finding import Cause, Finding, milliseconds, seconds
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.abilities.eyes.transfers import Way
from hil_bench.canopen_device.nmt import RESTORED, NmtRequest

LATE = 2.5
"""Periods after which a heartbeat counts as lost."""

_FEWEST = 4
_NOTICE = 5_000_000_000
_KEPT = 64
_HEARTBEAT_EMCY = 0x8130
_NS_PER_MS = 1_000_000


@dataclass(slots=True)
class _Pulse:
    """The heartbeat of one node.

    Attributes:
        last: the last one; None where the next begins anew.
        due_from: when the next one's time began [ns].
        intervals: the last ones [ns].
        gap: the first time that it stayed out: the beats before and behind, and its period [ns].
        gaps: how often it stayed out.
    """

    last: Sight | None = None
    due_from: int = 0
    intervals: deque[int] = field(default_factory=lambda: deque(maxlen=15))
    gap: tuple[Sight, Sight | None, float] | None = None
    gaps: int = 0


class Heartbeats:
    """Watches the period of each heartbeat: that of 0x1017, or else the usual one.

    Args:
        decoder: that gives the sights.
    """

    hears = frozenset({Service.NMT, Service.EMCY, Service.SDO, Service.HEARTBEAT})

    def __init__(self, decoder: Decoder) -> None:
        self._decoder = decoder
        self._pulses: dict[tuple[int, int], _Pulse] = {}
        self._emergencies: deque[Sight] = deque(maxlen=_KEPT)

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        if sight.service is Service.NMT:
            self._hear_command(sight)
        elif sight.emcy_code == _HEARTBEAT_EMCY:
            self._emergencies.append(sight)
        elif sight.service is Service.SDO and sight.transfer is not None:
            is_set = sight.transfer.index == 0x1017 and sight.transfer.way is Way.DOWNLOAD
            if is_set and sight.node_id is not None:
                self._forget(sight.frame.bus, sight.node_id)
        elif sight.service is Service.HEARTBEAT and sight.node_id is not None:
            self._hear_pulse(sight, sight.node_id)

    def findings(self, end: int) -> Iterator[Finding]:
        """Yield the nodes whose heartbeat stayed out.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        for key, pulse in self._pulses.items():
            period = self._period(key, pulse)
            gap, gaps = pulse.gap, pulse.gaps
            if pulse.last is not None and period and end - pulse.due_from > LATE * period:
                gap, gaps = gap or (pulse.last, None, period), gaps + 1
            if gap is not None:
                yield self._tell(gap, gaps)

    def pause(self, length: int) -> None:
        """Count from the end of a pause."""
        for pulse in self._pulses.values():
            pulse.due_from += length

    def _hear_command(self, sight: Sight) -> None:
        request = NmtRequest.parse(sight.frame.data)
        if request is not None and request.command in RESTORED:
            for bus, node_id in list(self._pulses):
                if bus == sight.frame.bus and request.addresses(node_id):
                    self._forget(bus, node_id)

    def _forget(self, bus: int, node_id: int) -> None:
        pulse = self._pulses.setdefault((bus, node_id), _Pulse())
        pulse.last = None
        pulse.intervals.clear()

    def _hear_pulse(self, sight: Sight, node_id: int) -> None:
        key = sight.frame.bus, node_id
        if sight.name == "boot-up":
            self._forget(*key)
            return
        if sight.frame.is_remote or len(sight.frame.data) != 1:
            return
        pulse = self._pulses.setdefault(key, _Pulse())
        if pulse.last is not None:
            interval, period = sight.now - pulse.due_from, self._period(key, pulse)
            if period and interval > LATE * period:
                pulse.gap = pulse.gap or (pulse.last, sight, period)
                pulse.gaps += 1
            else:
                pulse.intervals.append(interval)
        pulse.last, pulse.due_from = sight, sight.now

    def _period(self, key: tuple[int, int], pulse: _Pulse) -> float:
        """Return the period of a heartbeat [ns]; 0 where it has none that is known."""
        node = self._decoder.nodes.get(key)
        if node is not None and node.objects.find(0x1017) is not None:
            own = node.number(0x1017) * _NS_PER_MS
            if own or node.has_eds is False:
                return own
        return median(pulse.intervals) if len(pulse.intervals) >= _FEWEST else 0.0

    def _tell(self, gap: tuple[Sight, Sight | None, float], gaps: int) -> Finding:
        last, next_one, period = gap
        every = milliseconds(period)
        text = f"{last.node}: no heartbeat after {seconds(last.now)} (every {every} before)"
        if next_one is None:
            text += ", and none until the end"
        else:
            text += f", for {milliseconds(next_one.now - last.now)}"
        if gaps > 1:
            text += f"; {gaps - 1} times more"
        noticed = [
            emcy
            for emcy in self._emergencies
            if 0 <= emcy.now - last.now < _NOTICE and emcy.node != last.node
        ]
        if noticed:
            text += f"; {noticed[0].node} reports it at {seconds(noticed[0].now)}"
        sights = [last, *noticed[:1], *([next_one] if next_one else [])]
        shown = tuple(sights)
        return Finding(Cause.HEARTBEAT_LOST, last.node, last.now, text, shown, span=round(period))
