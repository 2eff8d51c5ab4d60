"""A frame as a recording holds it."""

from typing import NamedTuple

from hil_bench.canopen_device.frame import Frame


class LoggedFrame(NamedTuple):
    """A frame that was on the bus.

    Attributes:
        frame: the frame.
        now: when it was on the bus, on the recording's time base [ns].
        is_received: whether the recording side received it; otherwise it sent it.
    """

    frame: Frame
    now: int
    is_received: bool
