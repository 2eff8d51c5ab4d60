"""The tick of a bench with a bus of copper."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from hil_bench.bench.bench import Bench
from hil_bench.bench.switchboard import Switchboard
from hil_bench.bench.wiring import Wiring
from hil_bench.canopen_device.frame import Frame
from hil_bench.devices.axis import Axis, Fitting, Measurement
from hil_bench.devices.faults.faults import Faults
from hil_bench.frame import address_of

if TYPE_CHECKING:
    from hil_bench.outside.wire.wire import Passage


class WiredBench(Bench):
    """A bench whose frames take their time on the bus, and are heard when it is over.

    A tick hears what has passed by its time, and returns the frames of nodes among that. What nodes
    send in it goes to the bus at that time. Buses without a wire are as in `Bench`.

    Args:
        axes: as those of `Bench`.
        switchboard: with the wiring's ways to the buses.
        wiring: the buses of copper.
        steps: as those of `Bench`, and so is what follows.
        faults: likewise.
        fittings: likewise.
        sensors: likewise.

    Attributes:
        copper: the buses of copper, as `wiring`.
        passages: what this tick has heard from buses of copper, in the order of the ends.
        errors: error frames since the last tick, with their times [ns].
        direct: what it has received from other buses.
        at_once: what it has sent there.
    """

    def __init__(
        self,
        axes: Sequence[Axis],
        switchboard: Switchboard,
        wiring: Wiring,
        *,
        steps: int,
        faults: Faults | None = None,
        fittings: Sequence[Fitting] = (),
        sensors: Sequence[Measurement] = (),
    ) -> None:
        switchboard.emit = wiring.stray(switchboard.emit)
        super().__init__(
            axes, switchboard, steps=steps, faults=faults, fittings=fittings, sensors=sensors
        )
        self.wiring = self.copper = wiring
        self.passages: Sequence[Passage] = ()
        self.errors: Sequence[tuple[Frame, int]] = ()
        self.direct: Sequence[Frame] = ()
        self.at_once: Sequence[Frame] = ()
        self.is_timeless = _never

    def tick(self, frames: Sequence[Frame], now: int) -> list[Frame]:
        """Move the whole bench on by one tick; see `Bench.tick`."""
        wiring, overheard = self.copper, self._switchboard.overheard
        sent: list[Frame] = []
        while (passage := wiring.next_frame(now)) is not None:
            sent.append(passage[0])
        wiring.now = now
        self.direct = direct = wiring.put_all(frames, now)
        self.passages = passages = wiring.take_passed()
        self.errors = wiring.take_errors()
        heard = [
            wiring.frame_of(passage)
            for passage in passages
            if wiring.is_outside(passage)
            or wiring.is_extended(passage)
            or address_of(passage.frame.can_id, passage.frame.bus) in overheard
        ]
        for passed in passages:
            if wiring.is_outside(passed):
                self._switchboard.count_foreign(passed.frame, now)
        wiring.tell_nodes()
        self.at_once = at_once = super().tick([*heard, *direct] if direct else heard, now)
        wiring.forget()
        return sent + at_once

    def serve(self, frames: Sequence[Frame], now: int) -> list[Frame]:
        """Put frames on the buses; they are answered in a tick, since they take time."""
        self.passages, self.errors = (), ()
        self.direct = direct = self.copper.put_all(frames, now)
        self.at_once = at_once = super().serve(direct, now) if direct else []
        return at_once


def _never(_frame: Frame) -> bool:
    """Return False: no frame is served between two ticks, since it has to pass the bus."""
    return False
