"""Recordings played back: frames onto a bus, set-points into the plant.

The frames of a recording go back on a bus at the times that they were recorded at. The spool
set-points of a recording drive the plant of a configuration from the recording's first state on;
what the plant then does is compared with what was recorded.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from hil_bench.config import AxisConfig, BenchConfig, SinkConfig, ValveConfig
from hil_bench.errors import ConfigError
from hil_bench.plant import FullOrderPlant, PlantInput, PlantState
from hil_bench.plant.models import Model, plant_at_rest
from hil_bench.plant.stepping import Plant
from hil_bench.realtime.clock import Clock
from hil_bench.recording.channels import (
    TIME,
    Channel,
    Recording,
    recording_channels,
    recording_dtype,
)
from hil_bench.recording.logged_frame import LoggedFrame

COMPARED = {"position": "m", "speed": "m/s", "P_A": "Pa", "P_B": "Pa", "spool_position": "-"}
"""Quantities of an axis that are compared where a recording has them, with their units."""

TOLERANCES: Mapping[str, float] = {"position": 1e-3, "P_A": 2e5, "P_B": 2e5, "spool_position": 0.02}
"""Largest deviations that count as the same unless told otherwise, in the SI unit; others are shown
without judgement."""


class Direction(StrEnum):
    """Which frames of a recording are meant, as seen by who recorded them."""

    RECEIVED = "received"
    SENT = "sent"
    ALL = "all"

    def includes(self, logged: LoggedFrame) -> bool:
        """Return whether a frame is meant."""
        return self is Direction.ALL or (self is Direction.RECEIVED) == logged.is_received


@dataclass(frozen=True, slots=True)
class PlaybackReport:
    """What a playback did.

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
        stopped: asked before each frame.
    """
    start = clock.now()
    first: int | None = None
    count = latest = 0
    for logged in frames:
        if stopped():
            break
        first = logged.now if first is None else first
        due = start + round((logged.now - first) / speed)
        clock.sleep_until(due)
        late = clock.now() - due
        send(logged)
        count += 1
        latest = max(latest, late) if speed != float("inf") else 0
    return PlaybackReport(count, (clock.now() - start) * 1e-9, latest * 1e-9)


@dataclass(frozen=True, slots=True)
class Deviation:
    """How far a simulated signal is from the recorded one.

    Attributes:
        channel: its name.
        unit: its SI unit.
        rms: root mean square.
        maximum: largest absolute value.
        time: when that was [s].
        tolerance: the largest that is right; None where it is not judged.
    """

    channel: str
    unit: str
    rms: float
    maximum: float
    time: float
    tolerance: float | None

    @property
    def is_within(self) -> bool:
        """Whether it is right, or not judged."""
        return self.tolerance is None or self.maximum <= self.tolerance


def drive_plant(config: BenchConfig, recording: Recording) -> Recording:
    """Return what the plants of a configuration do under the recorded spool set-points.

    Args:
        config: the bench.
        recording: has ``AXIS.spool_setpoint``, and each quantity of the state at its first row.

    Returns:
        The `COMPARED` quantities of each axis at the times of the recording.

    Raises:
        ConfigError: the recording lacks what is needed.
    """
    if len(recording) < 2:
        raise ConfigError(
            f"the recording has {len(recording)} rows of signals; 2 or more are right"
        )
    names = [channel.name for channel in recording_channels(recording)]
    axes = (config.first_axis, *config.axes[1:])
    driven = [axis for axis in axes if f"{axis.name}.spool_setpoint" in names]
    if not driven:
        right = ", ".join(f"{axis.name}.spool_setpoint" for axis in axes)
        raise ConfigError(f"the recording has no spool set-point; it must have {right}")
    columns = [recording[TIME.name]]
    channels = [TIME]
    for axis in driven:
        columns += list(_drive(config, axis, recording).T)
        channels += [Channel(f"{axis.name}.{name}", unit) for name, unit in COMPARED.items()]
    rows = np.column_stack(columns)
    return np.ascontiguousarray(rows).view(recording_dtype(channels)).reshape(-1)


def compare_recordings(
    recorded: Recording, simulated: Recording, tolerances: Mapping[str, float]
) -> list[Deviation]:
    """Return the deviation of each simulated signal that was recorded too.

    Args:
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
    for name in tolerances.keys() - TOLERANCES.keys() - known:
        raise ConfigError(f"tolerance for {name}: not compared; {', '.join(sorted(known))} are")
    limits = {**TOLERANCES, **tolerances}
    deviations = []
    for channel in channels:
        error = np.abs(simulated[channel.name] - recorded[channel.name])
        worst = int(np.argmax(error))
        deviations.append(
            Deviation(
                channel.name,
                channel.unit,
                rms=float(np.sqrt(np.mean(error**2))),
                maximum=float(error[worst]),
                time=float(recorded[TIME.name][worst]),
                tolerance=limits.get(channel.name, limits.get(_quantity(channel))),
            )
        )
    return deviations


def _quantity(channel: Channel) -> str:
    return channel.name.rpartition(".")[2]


def _drive(config: BenchConfig, axis: AxisConfig, recording: Recording) -> npt.NDArray[np.float64]:
    """Return the `COMPARED` quantities of an axis, a row a row of the recording.

    Raises:
        ConfigError: the recording's time goes back.
    """
    full = full_opening(config, axis)
    plant = _plant_at_start(config, axis, recording, full)
    times = recording[TIME.name]
    steps = np.rint(np.diff(times, prepend=times[0]) / config.dt).astype(np.int64)
    if np.any(steps < 0):
        raise ConfigError(
            "the recording's time goes back; a recording in the order of time is right"
        )
    setpoints = recording[f"{axis.name}.spool_setpoint"] * full
    rows = np.empty((len(recording), len(COMPARED)))
    for number, (u, count) in enumerate(zip(setpoints.tolist(), steps.tolist(), strict=True)):
        output = plant.step(PlantInput(u), count)
        rows[number] = output.x, output.v, output.P_A, output.P_B, output.nu / full
    return rows


def full_opening(config: BenchConfig, axis: AxisConfig) -> float:
    """Return the spool position that stands for 1 in a recording [m]."""
    for node in config.nodes:
        if isinstance(node, ValveConfig) and node.axis == axis.name:
            return node.full_opening
        for binding in node.bindings:
            if isinstance(binding, SinkConfig) and binding.axis == axis.name:
                return binding.full_opening
    return axis.parameters.full_opening


def _plant_at_start(
    config: BenchConfig, axis: AxisConfig, recording: Recording, full: float
) -> Plant:
    """Return the plant of an axis in the state of the recording's first row.

    Raises:
        ConfigError: the recording does not have it.
    """
    names = recording.dtype.names or ()
    needed = [f"{axis.name}.{quantity}" for quantity in COMPARED]
    missing = [name for name in needed if name not in names]
    if axis.model is Model.FULL_ORDER and not missing:
        x, v, p_a, p_b, spool = (float(recording[name][0]) for name in needed)
        state = PlantState(x, v, p_a, p_b, spool * full, 0.0)
        return FullOrderPlant(
            axis.parameters, options=axis.options, solver=axis.solver, dt=config.dt, state=state
        )
    position = f"{axis.name}.position"
    if position not in names:
        raise ConfigError(f"the recording has no {position}; it must have one to begin with")
    return plant_at_rest(
        axis.model,
        axis.parameters,
        options=axis.options,
        solver=axis.solver,
        dt=config.dt,
        x=float(recording[position][0]),
        delay=axis.spool_delay,
    )
