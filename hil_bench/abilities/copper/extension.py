"""The buses of copper of a bench: what a tick hears of them, and what it leaves there."""

from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING

from hil_bench.abilities.copper.wiring import Plug, Wiring
from hil_bench.bench.bench import Bench, FrameObserver
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.words import can_text
from hil_bench.frame import address_of

if TYPE_CHECKING:
    from hil_bench.abilities.copper.wire.wire import Passage


class Copper:
    """The extension of a bench whose frames take their time on a bus, and are heard after it.

    A tick hears what has passed by its time, and returns the frames of nodes among that. What nodes
    send in it goes to the bus at that time. Buses without a wire are as ever.

    Args:
        wiring: the buses of copper.

    Attributes:
        wiring: as passed in.
        passages: what this tick has heard from buses of copper, in the order of the ends.
        errors: error frames since the last tick, with their times [ns].
        direct: what it has received from other buses.
        at_once: what it has sent there.
    """

    def __init__(self, wiring: Wiring) -> None:
        self.wiring = wiring
        self.passages: Sequence[Passage] = ()
        self.errors: Sequence[tuple[Frame, int]] = ()
        self.direct: Sequence[Frame] = ()
        self.at_once: Sequence[Frame] = ()
        self._passed: list[Frame] = []
        self.takes, self.put, self.next_frame = wiring.takes, wiring.put, wiring.next_frame

    @property
    def is_direct(self) -> bool:
        """True if a user in the same thread puts frames at any time, not with a tick."""
        return self.wiring.is_direct

    @is_direct.setter
    def is_direct(self, is_direct: bool) -> None:
        self.wiring.is_direct = is_direct

    def reported(self) -> list[Frame]:
        """Return the error frames of the last tick."""
        return [frame for frame, _ in self.errors]

    def point(self, device: object) -> Plug | None:
        """Return the plug of a device, where faults get at it; None where it is not on copper."""
        return self.wiring.plugs.get(device)

    def standing(self, device: object) -> dict[str, object] | None:
        """Return the status of the CAN controller of a device; None where it is not on copper."""
        plug = self.point(device)
        return None if plug is None else plug.standing()

    def lines(self, names: Sequence[str]) -> list[str]:
        """Return the counts of each bus of copper and the nodes with errors there.

        Args:
            names: of the buses, by their numbers.
        """
        lines = [
            f"wire      {names[number]}: {bus.wire.passed} frames passed, {bus.wire.failed} failed"
            + (
                f", {bus.controller.refused} of the controller lost"
                if bus.controller.refused
                else ""
            )
            for number, bus in self.wiring.buses.items()
        ]
        return lines + [
            f"          {plug.station.name}: {can_text(plug.standing())}"
            for plug in self.wiring.plugs.values()
            if plug.station.errors or plug.station.refused or plug.station.rec
        ]

    def join(self, bench: Bench) -> None:
        """Put the buses between the nodes and whoever is outside."""
        self._switchboard = board = bench.switchboard
        board.emit = self.wiring.stray(board.emit)
        board.knows_senders = True
        board.lay(self, self.wiring.ways())
        bench.medium = self
        bench.is_timeless = _never
        bench.arrivals.append(self._arrive)
        bench.served.append(self._serve)
        bench.departures.append(self._depart)
        bench.retells.append(self._retell)

    def _arrive(self, frames: Sequence[Frame], now: int) -> Sequence[Frame]:
        """Put frames on the buses; return what a tick hears."""
        wiring, overheard = self.wiring, self._switchboard.overheard
        self._passed = passed = []
        while (passage := wiring.next_frame(now)) is not None:
            passed.append(passage[0])
        wiring.now = now
        self.direct = direct = wiring.put_all(frames, now)
        self.passages = passages = wiring.take_passed()
        self.errors = wiring.take_errors()
        heard = [
            wiring.frame_of(each)
            for each in passages
            if wiring.is_outside(each)
            or wiring.is_extended(each)
            or address_of(each.frame.can_id, each.frame.bus) in overheard
        ]
        for each in passages:
            if wiring.is_outside(each):
                self._switchboard.count_foreign(each.frame, now)
        wiring.tell_nodes()
        return [*heard, *direct] if direct else heard

    def _serve(self, frames: Sequence[Frame], now: int) -> Sequence[Frame]:
        """Put frames on the buses; they are answered in a tick, since they take time."""
        self.passages, self.errors, self.at_once, self._passed = (), (), (), []
        self.direct = direct = self.wiring.put_all(frames, now)
        return direct

    def _depart(self, sent: Sequence[Frame], _now: int) -> Sequence[Frame]:
        """Add what has passed to what was sent at once."""
        self.at_once = sent
        self.wiring.forget()
        return [*self._passed, *sent]

    def _retell(self, observe: FrameObserver) -> FrameObserver:
        """Make an observer that is told each frame at its own time."""
        wiring = self.wiring

        def tell(_received: Sequence[Frame], _sent: Sequence[Frame], now: int) -> None:
            errors = deque(self.errors)
            for passage in self.passages:
                while errors and errors[0][1] <= passage.end:
                    frame, time = errors.popleft()
                    observe((frame,), (), time)
                if wiring.is_outside(passage):
                    observe((passage.frame,), (), passage.end)
                else:
                    observe((), (passage.frame,), passage.end)
            for frame, time in errors:
                observe((frame,), (), min(time, now))
            if self.direct or self.at_once:
                observe(self.direct, self.at_once, now)

        return tell


def _never(_frame: Frame) -> bool:
    """Return False: no frame is served between two ticks, since it has to pass the bus."""
    return False
