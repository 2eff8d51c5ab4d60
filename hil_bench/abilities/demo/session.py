"""A bench and a position controller on one bus inside this process, and their recording."""

import contextlib
import math
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from hil_bench.abilities.common.members import Members, find_members
from hil_bench.abilities.demo.sensors import (
    SensorBus,
    Sensors,
    Shaft,
    canopen_sensors,
    modbus_sensors,
)
from hil_bench.abilities.recording.report import RecordingWish
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.virtual_bench import VirtualBench
from hil_bench.cli.status_line import (
    Field,
    bench_status,
    bench_status_row,
)
from hil_bench.errors import ConfigError
from hil_bench.outside.helper_process import Snapshot
from hil_bench.outside.realtime.clock import MonotonicClock, ScaledClock
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.realtime.scheduling import undisturbed, undisturbed_by_garbage_collection
from hil_bench.outside.realtime.statistics import TickStatistics, TickSummary
from hil_bench.outside.recording.channels import Channel, Recording
from hil_bench.plants.hydraulic_cylinder import quantities
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig, require_cylinder
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import steady_motion
from hil_bench.plants.hydraulic_cylinder.resolution import eigenfrequency
from hil_bench.plants.hydraulic_cylinder.summary import damping_ratio, softest_position
from hil_bench.plants.plant import AxisConfig
from hil_bench.plants.rotary.configuration import ANGLE, RotaryConfig
from hil_drivers import (
    ControllerParameters,
    CycleRecord,
    DriverError,
    MotionProfile,
    Network,
    PositionController,
    PositionLoop,
    ProportionalValve,
)
from hil_drivers.network import HEARTBEAT_PERIOD

# The controller and the motion of the demo, to fit valve, cylinder and load.

_GAIN_SHARE = 0.2  # of the gain at which the loop becomes unstable
_LOWEST_DAMPING = 0.05  # which an axis has in motion, by the open edges of its valve
_SPEED, _SPEED_SHARE = 0.15, 0.6  # highest speed [m/s], and as a share of what the axis can
_LOWEST_SPEED = 0.01  # of an axis that its load holds [m/s]
_ACCELERATION = 1.5  # highest [m/s²]
_SWING_SHARE = 0.25  # of the speed that the axis may gain in a radian of its swing


_SHAFT_SPEED = 20.0 * math.pi  # highest speed [rad/s]
_SHAFT_SPAN = 60.0 * math.pi  # in place of the half-stroke [rad]
_SHAFT_TOLERANCE = 2e-3  # left alone at rest [rad]
_MOVES = (0.4, -0.3, 0.1, 0.5, 0.0)


class DemoAxis:
    """The axis that the demo moves, and its motion.

    Args:
        axis: a cylinder or a motor; `ConfigError` for another plant.

    Attributes:
        quantity: what is controlled: position [m] or angle [rad].
        turns: whether it is a motor.
    """

    def __init__(self, axis: AxisConfig) -> None:
        self.turns = isinstance(axis, RotaryConfig)
        self.quantity = ANGLE if self.turns else quantities.POSITION
        if isinstance(axis, RotaryConfig):
            self._cylinder, self._lever = axis.cylinder, axis.lever
        else:
            self._cylinder, self._lever = require_cylinder(axis, "the demo"), 1.0

    def parameters(self) -> ControllerParameters:
        """Return a controller that fits the axis."""
        found = tuned_parameters(self._cylinder)
        if not self.turns:
            return found
        return replace(found, full_speed=found.full_speed / self._lever, tolerance=_SHAFT_TOLERANCE)

    def profile(self, start: float) -> MotionProfile:
        """Return moves of different lengths, for ever, from where the axis is [m, rad]."""
        if not self.turns:
            return demo_profile(start, self._cylinder)
        p, lever = self._cylinder.parameters, self._lever
        motions = (steady_motion(p, self._cylinder.options, extends=each) for each in (True, False))
        top = min(motion.speed for motion in motions) / lever
        speed = max(min(_SHAFT_SPEED, _SPEED_SHARE * top), _LOWEST_SPEED / lever)
        return MotionProfile(
            start,
            [start + share * _SHAFT_SPAN for share in _MOVES],
            speed=speed,
            acceleration=_SWING_SHARE * speed * math.tau * eigenfrequency(self._cylinder, 0.0),
            dwell=0.4,
            repeat=True,
        )


def tuned_parameters(axis: CylinderConfig) -> ControllerParameters:
    """Return a controller that fits an axis.

    The gain is a fifth of where the loop becomes unstable, 2 D ω of the piston with its load on the
    oil (eqs. (18) to (20)) or of the spool, where that is slower. The speed at full opening is that
    of the reduced model without load, eqs. (14), (16), or what a compensator lets pass.
    """
    p = axis.parameters
    x = softest_position(p)
    damping = max(damping_ratio(axis, x), _LOWEST_DAMPING)
    of_piston = 2.0 * damping * math.tau * eigenfrequency(axis, x)
    drop = 0.5 * (p.P_S - p.P_T)
    full_speed = p.alpha * p.K * drop**0.5 / p.mean_area
    for extends in (True, False):
        motion = steady_motion(p, axis.options, extends=extends)
        if motion.is_compensated:
            full_speed = min(full_speed, motion.speed)
    return ControllerParameters(
        position_gain=_GAIN_SHARE * min(of_piston, 2.0 * p.xi * p.omega_0),
        full_speed=full_speed,
        dead_zone=p.beta / p.full_opening,
    )


def demo_profile(start: float, axis: CylinderConfig) -> MotionProfile:
    """Return moves of different lengths within half of the stroke, for ever.

    Args:
        start: where the piston is [m].
        axis: which moves as fast as it can follow, without swinging on its oil.
    """
    p = axis.parameters
    top = min(steady_motion(p, axis.options, extends=each).speed for each in (True, False))
    speed = max(min(_SPEED, _SPEED_SHARE * top), _LOWEST_SPEED)
    gentle = _SWING_SHARE * speed * math.tau * eigenfrequency(axis, softest_position(p))
    return MotionProfile(
        start,
        [share * p.h for share in _MOVES],
        speed=speed,
        acceleration=min(_ACCELERATION, gentle),
        dwell=0.4,
        repeat=True,
    )


CYCLE = 0.002
"""Period of the controller [s]."""

_SET_UP_TIME = 5.0  # more than it takes to boot and configure the nodes [s]
_BOOT_TIME = 1.0  # longest wait for the nodes; one that is silent answers SDO later, or never [s]
_LOGGED_FRAMES = 2_000_000


_SET = {
    "position": Field("set {:+z8.2f} mm", 1e3),
    "angle": Field("set {:+z9.3f} rev", 0.5 / math.pi),
}
"""The set-point in the status line, by the quantity that is controlled."""


class TrackingError(NamedTuple):
    """Root mean square and largest absolute value of a tracking error [m, rad]."""

    rms: float
    maximum: float


@dataclass(frozen=True, slots=True)
class DemoReport:
    """The results of the demo.

    Attributes:
        error: set-point minus position during the motion.
        bench_time: length of the motion on the bench's clock [s].
        wall_time: how long that took [s].
        cycles: cycles of the controller.
        overruns: cycles that the controller left out.
        ticks: statistics of the loop, None where it was not paced.
    """

    error: TrackingError
    bench_time: float
    wall_time: float
    cycles: int
    overruns: int
    ticks: TickSummary | None


class DemoSession:
    """Bench and controller in one thread: the controller's waits let the bench's ticks run.

    Args:
        config: the bench; its first axis is moved.
        duration: length of the motion [s].
        is_paced: whether the ticks wait for real time.
        speed: how fast that passes.
        sensors: where the controller reads the sensors; the valve is on CANopen.
        recording: what to record while it runs.

    Attributes:
        axis: what is moved.
        bench: the bench with its traces, set-point of the motion included.
        snapshot: what the status line shows.
        fields: how it shows it.
        statistics: of the loop, None where it is not paced.
    """

    def __init__(
        self,
        config: BenchConfig,
        *,
        duration: float,
        is_paced: bool,
        speed: float = 1.0,
        sensors: SensorBus = SensorBus.CANOPEN,
        recording: RecordingWish | None = None,
    ) -> None:
        self._config = config
        self._duration = duration
        self._sensor_bus = sensors
        self.statistics = TickStatistics(is_shared=True) if is_paced else None
        self._pacer = (
            Pacer(ScaledClock(MonotonicClock(), speed), config.tick_ns, statistics=self.statistics)
            if is_paced
            else None
        )
        self._setpoint_at: Callable[[float], float] = no_setpoint
        self._cycle: CycleRecord | None = None
        self.axis = DemoAxis(config.first_axis)
        name, unit = self.axis.quantity[:2]
        setpoint = Channel(f"{config.first_axis.name}.{name}_setpoint", unit)
        self.bench = VirtualBench(
            config,
            recorded_time=duration + _SET_UP_TIME,
            logged_frames=_LOGGED_FRAMES,
            pacer=self._pacer,
            stimuli={setpoint: self._setpoint, **self._seen_by_controller()},
            record=recording,
        )
        self.bench.observers.append(self._publish)
        channels, fields = bench_status(self.bench.bench)
        self.snapshot = Snapshot(2 + len(channels))  # time and set-point first
        self.fields = [Field("{:6.1f} s", 1.0), _SET[name], *fields]

    def run(self, stopped: Callable[[], bool]) -> DemoReport:
        """Move the axis along its profile, until the end or until `stopped` says so.

        Raises:
            ConfigError: the controller could not work with the devices; it says why.
        """
        bus = self.bench.bus
        try:
            with (
                self.bench,
                Network(bus, clock=bus.now) as network,
                self._undisturbed(),
            ):
                return self._control(network, stopped)
        except DriverError as error:
            raise ConfigError(f"the demo's controller: {error}") from error

    def _undisturbed(self) -> AbstractContextManager[object]:
        if self._pacer is None:
            return undisturbed_by_garbage_collection()
        return undisturbed(self._config.realtime, self._config.tick_ns)

    def _setpoint(self, time: float) -> float:
        """Return the set-point of the motion at a bench time [m]."""
        return self._setpoint_at(time)

    def _seen_by_controller(self) -> dict[Channel, Callable[[float], float]]:
        """Return channels of what the controller last got from its drivers."""
        axis = self._config.axes[0].name
        return {
            Channel(f"{axis}.{name}_seen", unit): partial(self._seen, field)
            for name, unit, field in (
                (*self.axis.quantity[:2], "position"),
                (*quantities.PRESSURE_A[:2], "pressure_a"),
                (*quantities.PRESSURE_B[:2], "pressure_b"),
                (*quantities.SPOOL_POSITION[:2], "spool_position"),
            )
        }

    def _seen(self, field: str, _time: float) -> float:
        return math.nan if self._cycle is None else float(getattr(self._cycle, field))

    def _publish(self, time: float) -> None:
        """Show the present values to the status line."""
        axes = bench_status_row(self.bench.bench)
        self.snapshot.write((time, self._setpoint(time), *axes))

    def _control(self, network: Network, stopped: Callable[[], bool]) -> DemoReport:
        position = self.bench.bench.axes[0].plant.output[self.axis.quantity.output or 0]
        profile = self.axis.profile(position)
        cycles = 0
        with self._ready_loop(network, position) as loop:
            wall_start = time.perf_counter()
            for record in loop.run(profile, self._duration):
                if not cycles:
                    self._setpoint_at = partial(setpoint_position, profile, network.now())
                cycles += 1
                self._cycle = record
                if stopped():
                    break
            self._setpoint_at = no_setpoint
            wall_time = time.perf_counter() - wall_start
        return DemoReport(
            error=tracking_error(
                self.bench.signals, f"{self._config.axes[0].name}.{self.axis.quantity.name}"
            ),
            bench_time=cycles * loop.period,
            wall_time=wall_time,
            cycles=cycles,
            overruns=loop.overruns,
            ticks=self.statistics.summary() if self.statistics else None,
        )

    @contextlib.contextmanager
    def _ready_loop(self, network: Network, position: float) -> Iterator[PositionLoop]:
        """Set the devices up, bring the valve to ACTIVE, and leave it disabled.

        Args:
            network: of the devices.
            position: where the axis is [m, rad].

        Yields:
            The control loop.
        """
        members = find_members(
            self._config, self._config.axes[0].name, "the demo", turns=self.axis.turns
        )
        with ProportionalValve(network, members.valve.node_id, members.valve.eds) as valve:
            sensors = self._sensors(network, members)
            network.wait_for(lambda: all(n.boot_ups for n in network.nodes.values()), _BOOT_TIME)
            network.start_heartbeat()
            if isinstance(sensors.position, Shaft):
                sensors.position.begin_at(position)
            valve.setup(heartbeat_timeout=4 * HEARTBEAT_PERIOD)
            for sensor in (sensors.position, *sensors.pressures):
                sensor.setup()
            started = members if self._sensor_bus is SensorBus.CANOPEN else members[:1]
            for node in self._config.nodes:
                if node in started:
                    network.start_node(node.node_id)
            valve.enable()
            yield PositionLoop(
                network,
                valve=valve,
                position=sensors.position,
                pressures=sensors.pressures,
                controller=PositionController(self.axis.parameters()),
                period=CYCLE,
            )

    def _sensors(self, network: Network, members: Members) -> Sensors:
        if self._sensor_bus is SensorBus.CANOPEN:
            return canopen_sensors(network, members)
        return modbus_sensors(self.bench, self._config, members)


def no_setpoint(_time: float) -> float:
    """Return NaN: there is no motion."""
    return math.nan


def setpoint_position(profile: MotionProfile, start: float, time: float) -> float:
    """Return the set-point [m] at a time of a profile that began at `start` [s]."""
    return profile.at(time - start).position


def tracking_error(recording: Recording, quantity: str) -> TrackingError:
    """Return the error of a quantity over the rows that have a set-point; NaN without any."""
    error = recording[f"{quantity}_setpoint"] - recording[quantity]
    error = error[np.isfinite(error)]
    if not error.size:
        return TrackingError(math.nan, math.nan)
    return TrackingError(float(np.sqrt(np.mean(error**2))), float(np.max(np.abs(error))))
