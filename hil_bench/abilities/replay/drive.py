"""Recordings played back: frames onto a bus, set-points into the plant.

The frames of a recording go back on a bus at the times that they were recorded at. The spool
set-points of a recording drive the plant of a configuration from the recording's first state on;
what the plant then does is compared with what was recorded.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.common.together import axes_with, build_together
from hil_bench.bench.configuration import AxisConfig, BenchConfig
from hil_bench.errors import ConfigError
from hil_bench.outside.realtime.clock import Clock
from hil_bench.outside.recording.channels import (
    TIME,
    Channel,
    LoggedFrame,
    Recording,
    recording_channels,
    recording_dtype,
)
from hil_bench.plants.plant import Quantity

_LONGEST_WAIT = 3600.0
"""Longest time from row to row [s]: the plant holds a command meanwhile, and computes each step."""
_LOOK = 100_000_000
"""Longest sleep before a look for an interruption [ns]."""
_LEAP = 10.0
"""Times the usual from row to row from which on what was between two rows counts as not seen."""
_AT_ONCE = 10_000
"""Most steps of the plant in one call: an interruption waits for its end."""


def compared(axis: AxisConfig) -> list[Quantity]:
    """Return the quantities of an axis that are compared where a recording has them.

    The largest deviation that counts as the same unless told otherwise is the quantity's tolerance;
    without one it is shown without judgement.
    """
    return [quantity for quantity in axis.kind.outputs if quantity.is_recorded]


class FrameDirection(StrEnum):
    """The direction of a recording's frames, as seen by its recorder."""

    RECEIVED = "received"
    SENT = "sent"
    ALL = "all"

    def includes(self, logged: LoggedFrame) -> bool:
        """Return True if a frame is meant."""
        return self is FrameDirection.ALL or (self is FrameDirection.RECEIVED) == logged.is_received


@dataclass(frozen=True, slots=True)
class PlaybackReport:
    """The result of a playback.

    Attributes:
        frames: sent.
        duration: from the first to the last [s].
        latest: the largest delay of a frame [s].
    """

    frames: int
    duration: float
    latest: float


def play_frames(
    frames: Iterable[LoggedFrame],
    send: Callable[[LoggedFrame], None],
    clock: Clock,
    *,
    speed: float = 1.0,
    stopped: Callable[[], bool] = lambda: False,
) -> PlaybackReport:
    """Send frames with their timing.

    Args:
        frames: in the order of time.
        send: takes each frame when it is due.
        clock: to wait on.
        speed: how much faster than recorded; infinite for without waiting.
        stopped: asked before each frame, and while the next one is waited for.
    """
    start = clock.now()
    first: int | None = None
    count = latest = 0
    for logged in frames:
        first = logged.now if first is None else first
        due = start + round((logged.now - first) / speed)
        while (now := clock.now()) < due and not stopped():
            clock.sleep_until(min(due, now + _LOOK))
        if stopped():
            break
        late = clock.now() - due
        send(logged)
        count += 1
        latest = max(latest, late) if speed != float("inf") else 0
    return PlaybackReport(count, (clock.now() - start) * 1e-9, latest * 1e-9)


class Verdict(StrEnum):
    """The verdict on a simulated signal."""

    PASSED = "passed"
    FAILED = "failed"
    INCONCLUSIVE = "inconclusive"
    NOT_JUDGED = "not judged"


@dataclass(frozen=True, slots=True)
class SignalDeviation:
    """The deviation of a simulated signal from the recorded one.

    Attributes:
        channel: its name.
        unit: its SI unit.
        rms: root mean square; NaN where it was never seen.
        maximum: largest absolute value; likewise.
        time: when that was [s].
        tolerance: the largest that is right; None where it is not judged.
        seen: for how long the recording has it [s].
        duration: of the recording [s].
    """

    channel: str
    unit: str
    rms: float
    maximum: float
    time: float
    tolerance: float | None
    seen: float
    duration: float

    @property
    def verdict(self) -> Verdict:
        """The verdict: what was not seen throughout has not passed."""
        if self.tolerance is None:
            return Verdict.NOT_JUDGED
        if self.maximum > self.tolerance:
            return Verdict.FAILED
        return Verdict.PASSED if self.seen == self.duration else Verdict.INCONCLUSIVE


def drive_plant(config: BenchConfig, recording: Recording) -> Recording:
    """Run the plants of a configuration under the recorded spool set-points.

    Args:
        config: the bench.
        recording: has ``AXIS.spool_setpoint``, and each quantity of the state at its first row;
            of another kind of plant the command that it has.

    Returns:
        The `compared` quantities of each axis at the times of the recording.

    Raises:
        ConfigError: the recording lacks what is needed.
    """
    if len(recording) < 2:
        raise ConfigError(
            f"the recording has {len(recording)} rows of signals; 2 or more are needed"
        )
    names = [channel.name for channel in recording_channels(recording)]
    axes = (config.first_axis, *config.axes[1:])
    driven = [axis for axis in axes if _command_of(axis) in names]
    if not driven:
        right = ", ".join(map(_command_of, axes))
        raise ConfigError(f"the recording has no spool set-point; it must have {right}")
    moved = {
        axis.name: rows
        for axes in _together(config, driven)
        for axis, rows in zip(axes, _drive(config, axes, recording), strict=True)
    }
    columns = [recording[TIME.name]]
    channels = [TIME]
    for axis in driven:
        columns += list(moved[axis.name].T)
        channels += [Channel(f"{axis.name}.{each.name}", each.unit) for each in compared(axis)]
    rows = np.column_stack(columns)
    return np.ascontiguousarray(rows).view(recording_dtype(channels)).reshape(-1)


def compare_recordings(
    config: BenchConfig,
    recorded: Recording,
    simulated: Recording,
    tolerances: Mapping[str, float],
) -> list[SignalDeviation]:
    """Return the deviation of each simulated signal that was recorded too.

    Args:
        config: the bench whose plants were driven.
        recorded: the measurement.
        simulated: at the same times.
        tolerances: largest deviation by the name of a channel, or by its last part for all axes,
            in the SI unit.

    Raises:
        ConfigError: a tolerance is for no signal that is compared.
    """
    names = recorded.dtype.names or ()
    channels = [channel for channel in recording_channels(simulated)[1:] if channel.name in names]
    known = {name for channel in channels for name in (channel.name, _quantity(channel))}
    usual = default_tolerances(config)
    for name in sorted(tolerances.keys() - known):
        raise ConfigError(f"tolerance for {name}: not compared; {', '.join(sorted(known))} are")
    deviations = []
    times = recorded[TIME.name]
    waits = np.diff(times, prepend=times[0])
    is_leap = waits > _LEAP * np.median(waits[waits > 0.0]) if waits.any() else waits > 0.0
    duration = float(np.sum(waits))
    for channel in channels:
        error = np.abs(simulated[channel.name] - recorded[channel.name])
        is_known = np.isfinite(error)
        is_seen = is_known & np.append(True, is_known[:-1]) & ~is_leap  # from row to row
        known = error[is_known]
        worst = int(np.argmax(np.where(is_known, error, -1.0)))
        deviations.append(
            SignalDeviation(
                channel.name,
                channel.unit,
                rms=float(np.sqrt(np.mean(known**2))) if known.size else math.nan,
                maximum=float(error[worst]),
                time=float(times[worst]),
                seen=duration - float(np.sum(waits, where=~is_seen)),
                duration=duration,
                tolerance=tolerances.get(
                    channel.name, tolerances.get(_quantity(channel), usual.get(channel.name))
                ),
            )
        )
    return deviations


def default_tolerances(config: BenchConfig) -> dict[str, float]:
    """Return the largest deviations that count as the same [SI], by the names of channels."""
    return {
        f"{axis.name}.{quantity.name}": quantity.tolerance
        for axis in config.axes
        for quantity in compared(axis)
        if quantity.tolerance is not None
    }


def _command_of(axis: AxisConfig) -> str:
    return f"{axis.name}.{axis.kind.command.name}"


def _quantity(channel: Channel) -> str:
    return channel.name.rpartition(".")[2]


def _together(config: BenchConfig, driven: Sequence[AxisConfig]) -> Iterator[list[AxisConfig]]:
    """Yield the axes that move at once: those of each supply, and all others by themselves.

    Raises:
        ConfigError: an axis of a supply has no recorded command.
    """
    left = [axis.name for axis in driven]
    for axis in driven:
        if axis.name not in left:
            continue
        axes = axes_with(config, axis)
        for each in axes:
            if each.name not in left:
                wrong = f"the recording has no {_command_of(each)}"
                right = f"it must have one, for {each.name} and {axis.name} share their supply"
                raise ConfigError(f"{wrong}; {right}")
            left.remove(each.name)
        yield axes


def _drive(
    config: BenchConfig, axes: Sequence[AxisConfig], recording: Recording
) -> list[npt.NDArray[np.float64]]:
    """Return the `compared` quantities of axes that move at once, a row a row of the recording."""
    starts = [_state_at_start(axis, recording, config.full_scale(axis)) for axis in axes]
    group = build_together(config, axes, starts)
    steps = _steps_between(recording[TIME.name], config.dt)
    commands = []
    for axis in axes:
        share = config.full_scale(axis) if axis.kind.command.is_share else 1.0
        commands.append((recording[_command_of(axis)] * share).tolist())
        _check_command(recording, _command_of(axis))
    places = [[quantity.output or 0 for quantity in compared(axis)] for axis in axes]
    tables = [np.empty((len(recording), len(each))) for each in places]
    for number, count in enumerate(steps):
        held = [each[number] for each in commands]
        outputs = group.drive(held, min(_AT_ONCE, count))
        for begun in range(_AT_ONCE, count, _AT_ONCE):
            outputs = group.drive(held, min(_AT_ONCE, count - begun))
        for table, output, place in zip(tables, outputs, places, strict=True):
            table[number] = [output[each] for each in place]
    for axis, table in zip(axes, tables, strict=True):
        for column, quantity in enumerate(compared(axis)):
            if quantity.is_share:
                table[:, column] /= config.full_scale(axis)
    return tables


def _check_command(recording: Recording, name: str) -> None:
    """Refuse a command that is not known throughout.

    Raises:
        ConfigError: it says in which row it is unknown first.
    """
    (unknown,) = np.nonzero(~np.isfinite(recording[name]))
    if len(unknown):
        row = int(unknown[0])
        what = f"{name} is unknown in {len(unknown)} rows, first in row {row + 1}"
        at = f"at {recording[TIME.name][row]:g} s"
        raise ConfigError(f"{what}, {at}; give a recording that has it in each row")


def _steps_between(times: npt.NDArray[np.float64], dt: float) -> list[int]:
    """Return the steps of the plant from the row before to each row.

    Raises:
        ConfigError: the time goes back, or leaps.
    """
    waits = np.diff(times, prepend=times[0])
    (leaps,) = np.nonzero(~(waits <= _LONGEST_WAIT))
    if np.any(waits < -dt / 2):
        raise ConfigError("the recording's time goes back; give a recording in the order of time")
    if len(leaps):
        row = max(int(leaps[0]), 1)
        wrong = f"the recording's row after {times[row - 1]:g} s is at {times[row]:g} s"
        raise ConfigError(f"{wrong}; give rows at most {_LONGEST_WAIT:g} s apart")
    ticks = np.rint((times - times[0]) / dt)  # of the whole, or what is rounded away adds up
    steps: list[int] = np.diff(ticks, prepend=0.0).astype(np.int64).tolist()
    return steps


def _state_at_start(axis: AxisConfig, recording: Recording, full: float) -> dict[str, float]:
    """Return the state of an axis in the recording's first row.

    Raises:
        ConfigError: the recording does not have it.
    """
    names = recording.dtype.names or ()
    first = recording[0]
    start = {
        quantity.name: float(first[name]) * (full if quantity.is_share else 1.0)
        for quantity in compared(axis)
        if (name := f"{axis.name}.{quantity.name}") in names and math.isfinite(first[name])
    }
    if axis.kind.start_with not in start:
        needed = f"{axis.name}.{axis.kind.start_with}"
        where = " in its first row" if needed in names else ""
        raise ConfigError(f"the recording has no {needed}{where}; it must have one to begin with")
    return start
