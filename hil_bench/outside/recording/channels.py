"""The content of recordings: channels with a row a tick, frames, and named times."""

from collections.abc import Sequence
from struct import Struct
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ConfigError

# Channels: what is recorded each tick, kept in a ring that never grows.

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    Recording = npt.NDArray[np.void]
else:
    Recording = Any  # NumPy takes a tenth of a second to import: those who record have it
"""A structured array, a row a tick: field `time` [s] first, then a float64 field a channel."""


class Channel(NamedTuple):
    """One recorded quantity.

    Attributes:
        name: the name of its field, as in ``axis1.position``.
        unit: the symbol of its SI unit, as in ``m/s``; ``-`` for a pure number.
    """

    name: str
    unit: str


TIME = Channel("time", "s")


class RowSink(Protocol):
    """Takes rows, as a recording."""

    def append_row(self, values: Sequence[float]) -> None:
        """Take a row: time [s], then a value a channel in its SI unit."""


class ChannelRecorder:
    """A ring of rows, one a tick; when it is full, the oldest row makes room.

    Args:
        channels: the quantities of a row after `TIME`, which is always the first.
        capacity: rows that the ring holds.

    Raises:
        ConfigError: two channels have one name, or the ring would hold nothing.
    """

    def __init__(self, channels: Sequence[Channel], capacity: int) -> None:
        import numpy as np  # noqa: PLC0415 - as above

        self.channels = (TIME, *channels)
        self._dtype = recording_dtype(self.channels)
        if capacity < 1:
            raise ConfigError(f"recording capacity: {capacity} rows hold nothing; give 1 or more")
        self._capacity = capacity
        # Touched now, so that no page fault costs a tick later.
        self._rows = np.full((capacity, len(self.channels)), np.nan)
        row = Struct(f"{len(self.channels)}d")  # packs in a quarter of the time of an assignment
        self._pack, self._row_bytes, self._bytes = (
            row.pack_into,
            row.size,
            self._rows.data.cast("B"),
        )
        self._next = 0
        self._is_full = False

    def append(self, values: Sequence[float]) -> None:
        """Store one row: time [s], then one value a channel in its SI unit."""
        self._pack(self._bytes, self._next * self._row_bytes, *values)
        self._next += 1
        if self._next == self._capacity:
            self._next = 0
            self._is_full = True

    def latest(self) -> dict[str, float]:
        """Return the values of the last row by the names of their channels; none before it."""
        if not self._next and not self._is_full:
            return {}
        values = self._rows[self._next - 1].tolist()
        return dict(zip((channel.name for channel in self.channels), values, strict=True))

    def result(self) -> Recording:
        """Return a copy of the rows in the order of time."""
        import numpy as np  # noqa: PLC0415 - as above

        rows = self._rows[: self._next]
        if self._is_full:
            rows = np.concatenate((self._rows[self._next :], rows))
        return np.ascontiguousarray(rows).copy().view(self._dtype).reshape(-1)


def recording_dtype(channels: Sequence[Channel]) -> "np.dtype[np.void]":
    """Return the type of a recording's rows; each field carries its unit as metadata.

    Raises:
        ConfigError: two channels have one name.
    """
    import numpy as np  # noqa: PLC0415 - as above

    names = [channel.name for channel in channels]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f"recording channel {name}: is there twice; give each its own name")
    fields: list[Any] = [
        (channel.name, np.dtype(np.float64, metadata={"unit": channel.unit}))
        for channel in channels
    ]
    return np.dtype(fields)


def recording_channels(recording: Recording) -> tuple[Channel, ...]:
    """Return the channels of a recording, `TIME` first."""
    dtype = recording.dtype
    return tuple(
        Channel(name, dict(dtype[name].metadata or {}).get("unit", "-"))
        for name in dtype.names or ()
    )


# A frame as a recording holds it.


class LoggedFrame(NamedTuple):
    """A frame that was on the bus.

    Attributes:
        frame: the frame.
        now: when it was on the bus, on the recording's time base [ns].
        is_received: whether the recording side received it; False where it sent it, None where the
            file does not say.
    """

    frame: Frame
    now: int
    is_received: bool | None


# Times of a recording with a name, such as those of its faults.


class Span(NamedTuple):
    """A time in which something was otherwise, such as a fault.

    Attributes:
        begin: [s].
        end: [s].
        label: what it was.
    """

    begin: float
    end: float
    label: str
