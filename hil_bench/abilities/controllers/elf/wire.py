"""The bus between a chip's CAN controller and the bench: one frame after the other."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

from hil_bench.abilities.controllers.elf.core_view import Core
from hil_bench.abilities.controllers.seam import TimedFrame, make_timed
from hil_bench.canopen_device.frame import Frame, make_frame

GAP_NS: Final = 50_000
"""From one frame to the next on a bus that takes no time: as the shortest come at 1 Mbit/s."""


class Wire:
    """A bus.

    Where a bit takes no time, as on vcan, frames come `GAP_NS` apart and wait for room in the FIFO
    that wants them; where it does, a full FIFO loses frames.

    Args:
        core: of the chip.
        number: of the bus, as its controller counts.
        bit_ns: duration of a bit [ns]; 0 for a bus that takes no time.
        delay: returns how much later than it could the next frame to the chip begins [ns].

    Attributes:
        receive: takes a frame that has passed; returns False where it has no room and may wait.
        may_wait: whether a frame waits for room.
        sent: what the chip has sent, each with the time at which it had passed.
    """

    def __init__(
        self,
        core: Core,
        number: int,
        bit_ns: int,
        *,
        delay: Callable[[], int] = lambda: 0,
    ) -> None:
        self._core, self._number, self._bit_ns, self._delay = core, number, bit_ns, delay
        self.receive: Callable[[Frame], bool] = lambda _: True
        self.may_wait = bit_ns == 0
        self.sent: list[TimedFrame] = []
        self._coming: deque[Frame] = deque()
        self._going: tuple[Frame, Callable[[], None]] | None = None
        self._is_busy = self._is_full = False
        self._free_at = 0  # for the next frame that comes [ns]

    def reset(self) -> None:
        """Forget what has not passed yet."""
        self._coming.clear()
        self._going = None
        self._is_busy = self._is_full = False

    def duration(self, frame: Frame) -> int:
        """Return the time that a frame takes with the space behind it, without stuff bits [ns]."""
        bits = (67 if frame.is_extended else 47) + 8 * len(frame.data)
        return bits * self._bit_ns

    def bring(self, frames: Sequence[Frame]) -> None:
        """Have frames of the bench come, one after the other."""
        self._coming.extend(frames)
        self._go_on()

    def make_room(self) -> None:
        """Have a frame that waits for room come."""
        if self._is_full:
            self._is_full = False
            self._core.alarm(self._core.now(), self._go_on)

    def send(self, frame: Frame, done: Callable[[], None]) -> None:
        """Have a frame of the chip go; only one waits at a time.

        Args:
            frame: of the chip.
            done: is called when it has passed.
        """
        self._going = frame, done
        self._go_on()

    def _go_on(self) -> None:
        """Begin the frame that wins: the least identifier."""
        if self._is_busy or not (self._going or (self._coming and not self._is_full)):
            return
        self._is_busy = True
        going = self._going
        is_first = self._coming and not self._is_full
        if going and not (is_first and rank(self._coming[0]) < rank(going[0])):
            self._going = None
            self._core.alarm(self._core.now() + self.duration(going[0]), lambda: self._went(*going))
            return
        begin = max(self._core.now(), self._free_at) + self._delay()
        self._core.alarm(begin + self.duration(self._coming[0]), self._came)

    def _went(self, frame: Frame, done: Callable[[], None]) -> None:
        self._is_busy = False
        can_id, data, is_remote, is_extended, _, flags = frame
        sent = make_frame(Frame, (can_id, data, is_remote, is_extended, self._number, flags))
        self.sent.append(make_timed(TimedFrame, (self._core.now(), sent)))
        done()
        self._go_on()

    def _came(self) -> None:
        self._is_busy = False
        self._is_full = not self.receive(self._coming[0])
        if not self._is_full:
            self._coming.popleft()
            if self.may_wait:
                self._free_at = self._core.now() + GAP_NS
        self._go_on()


def rank(frame: Frame) -> tuple[int, int]:
    """Return the rank of a frame in arbitration; the least wins."""
    if frame.is_extended:
        return frame.can_id >> 18, 1 << 18 | frame.can_id & 0x3FFFF
    return frame.can_id, 0
