"""Records what passes a bus as a controller sees it."""

from collections.abc import Callable

import can

from hil_bench.outside.messages import frame_of
from hil_bench.outside.recording.inline_recorder import RecordingSink


class NetworkTap:
    """An observer of the drivers' `Network` that records its frames.

    Args:
        recording: what takes the frames; its time 0 is now.
        clock: the network's time [s].

    Attributes:
        origin: time 0 of the recording on that clock [s].
    """

    def __init__(self, recording: RecordingSink, clock: Callable[[], float]) -> None:
        self._recording = recording
        self._clock = clock
        self.origin = clock()

    def now(self) -> float:
        """Return the time on the recording's time base [s]."""
        return self._clock() - self.origin

    def observe(self, message: can.Message) -> None:
        """Record a frame that the network received or sent."""
        frame = frame_of(message)
        if frame is None:
            return
        self._recording.append_frames([frame], round(self.now() * 1e9), is_received=message.is_rx)
