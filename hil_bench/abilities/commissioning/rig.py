"""The axis under commission, from the drivers' side: sampled, guarded, recorded.

Each cycle sends a SYNC, waits for the values of all devices, checks them against the limits of the
step, and only then commands the valve. Leaving a limit, a value that does not come, a device that
reboots or a fault of the valve closes the valve before anything else happens.
"""

import contextlib
import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hil_bench.abilities.commissioning import comparison
from hil_bench.abilities.commissioning.journal import BorrowedNodes, Returned, SettingsJournal
from hil_bench.abilities.commissioning.measures import (
    SAMPLE_CHANNELS,
    Diagnosis,
    Measure,
    StepResult,
    Verdict,
)
from hil_bench.abilities.commissioning.plan import (
    LimitError,
    Limits,
    Sample,
    Step,
    check_sample,
    expected_speed,
)
from hil_bench.abilities.common.members import Members
from hil_bench.bench.configuration import BenchConfig
from hil_bench.outside.recording.channels import TIME, Recording, RowSink, recording_dtype
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_bench.plants.hydraulic_cylinder.model import PlantParameters
from hil_bench.plants.hydraulic_cylinder.quantities import P_A, P_B
from hil_drivers import (
    DriverError,
    Network,
    PositionSensor,
    PressureSensor,
    ProportionalValve,
    ValveState,
)
from hil_drivers.network import HEARTBEAT_PERIOD

logger = logging.getLogger(__name__)

COMMAND_TIMEOUT = 0.1
"""Time without command after which the valve closes by itself [s]."""

ANSWER_TIMEOUT = 0.1
"""Longest wait for the answer to a SYNC [s]."""


MOST_LEFT_OUT = 0.1
"""Share of samples that a motion may lack and still be judged."""

ROUNDING = 1e-6
"""What the division of two times may lack of a whole number."""


_CLOSED = {ValveState.NOT_READY, ValveState.INIT, ValveState.DISABLED, ValveState.FAULT_DISABLED}


class Rig:
    """The drivers of one axis, sampled in step.

    Args:
        network: the network that they are on.
        members: the nodes of the axis.
        period: between two samples [s].
        recording: takes each sample and the step's number; None for nobody.
        origin: time 0 of the recording on the network's clock [s]; None for now.
        journal: notes what is written to the nodes.

    Attributes:
        valve: its driver.
        period: as passed in.
        missed: cycles in which not every device answered in time.
    """

    def __init__(
        self,
        network: Network,
        members: Members,
        *,
        period: float,
        recording: RowSink | None = None,
        origin: float | None = None,
        journal: SettingsJournal | None = None,
    ) -> None:
        self._network = network
        self._recording = recording
        self.period = period
        self.missed = 0
        node = members.valve
        self.valve = ProportionalValve(network, node.node_id, node.eds)
        self._position = PositionSensor(network, members.position.node_id, members.position.eds)
        self._pressures = tuple(
            PressureSensor(network, node.node_id, node.eds)
            for node in (members.pressure_a, members.pressure_b)
        )
        self._devices = (self.valve, self._position, *self._pressures)
        nodes = [device.node for device in self._devices]
        self._borrowed = BorrowedNodes(network, nodes, journal)
        self._limits: Limits | None = None
        self._step_start = self._next = network.now()
        self._origin = self._next if origin is None else origin
        self._step_number = 0
        self._boot_ups: tuple[int, ...] = ()
        self._may_be_open = True  # whoever had it before us
        self._is_closed = False

    def set_up(self) -> None:
        """Configure the devices, bring their nodes to OPERATIONAL and take first values."""
        network = self._network
        begin = network.now()
        network.start_heartbeat()
        self.valve.setup(command_timeout=COMMAND_TIMEOUT, heartbeat_timeout=4 * HEARTBEAT_PERIOD)
        self._position.setup()
        for sensor in self._pressures:
            sensor.setup()
        self._borrowed.start(begin)
        since = network.now()
        network.sync()
        for device in self._devices:
            network.wait_until(
                lambda device=device: device.received_at > since,  # type: ignore[misc]
                1.0,
                f"{device.node}: first value with SYNC",
            )
        self._boot_ups = self._count_boot_ups()

    def begin_step(self, number: int, limits: Limits) -> None:
        """Take the limits of a step, whose time begins now."""
        self._limits = limits
        self._step_number = number
        self._step_start = self._next = self._network.now()

    def enable(self) -> None:
        """Bring the valve to ACTIVE with the spool centred."""
        self._may_be_open = True
        self.valve.reset_fault()
        self.valve.enable()
        self._next = self._network.now()

    def close_valve(self) -> bool:
        """Centre the spool at once and disable the valve, if it is not yet; never raises.

        Returns:
            Whether the valve is closed by its own words.
        """
        if self._may_be_open:
            self._may_be_open = False
            try:
                self.valve.spool_setpoint = 0.0
                self.valve.disable()
                self._is_closed = True
            except DriverError as error:
                logger.info("%s: spool centred, but not disabled: %s", self.valve.node, error)
                self._is_closed = self._says_closed()
        return self._is_closed

    def close(self) -> Returned:
        """Leave the valve disabled and the nodes as they were found, as far as they answer.

        Never raises a `DriverError`. An interruption leaves out what it interrupts, not the rest.
        """
        self._borrowed.end()
        with contextlib.suppress(KeyboardInterrupt):
            self.valve.close()
        self._network.stop_heartbeat()
        return self._borrowed.give_back()

    def move(self, command: Callable[[float], float], duration: float) -> Recording:
        """Command the spool for some time, from now on, and return the samples.

        Whatever goes wrong closes the valve first.

        Args:
            command: set-point [-] at a time since now [s].
            duration: how long [s].
        """
        try:
            return self._sample_for(duration, command)
        except BaseException:
            self.close_valve()
            raise

    def watch(self, duration: float) -> Recording:
        """Return samples of some time [s] without any command."""
        return self._sample_for(duration, None)

    def move_to(self, target: float, approach: Callable[[float], float], *, timeout: float) -> None:
        """Bring the piston to a position.

        Args:
            target: [m].
            approach: set-point [-] for a distance still to go [m]; 0 where it is near enough.
            timeout: longest time [s].

        Raises:
            LimitError: it did not get there.
        """
        end = self._network.now() + timeout
        try:
            u = 0.0
            while self._network.now() < end:
                sample = self._cycle(u)
                u = approach(target - sample.position)
                if u == 0.0 and abs(sample.speed) < 1e-3:
                    self._cycle(0.0)
                    return
        except BaseException:
            self.close_valve()
            raise
        self.close_valve()
        raise LimitError(f"position {target * 1e3:.0f} mm not reached within {timeout:g} s")

    def _sample_for(self, duration: float, command: Callable[[float], float] | None) -> Recording:
        """Take a sample at each point of a grid of periods; what is late leaves points out.

        Raises:
            LimitError: too many were left out.
        """
        rows = []
        start = self._network.now()
        count = round(duration / self.period)
        number = 0
        while number < count:
            time = number * self.period
            self._next = start + time
            rows.append(self._cycle(None if command is None else command(time)))
            passed = int((self._network.now() - start) / self.period + ROUNDING)
            number = max(number + 1, passed)
        left_out = 1.0 - len(rows) / count
        if left_out > MOST_LEFT_OUT:
            raise LimitError(
                f"{left_out:.0%} of the samples were left out: this computer or this bus is too "
                f"slow for period_ms = {self.period * 1e3:g}; give a longer one"
            )
        samples = np.array(rows, dtype=np.float64)
        samples[:, 0] -= start - self._origin
        return samples.view(recording_dtype((TIME, *SAMPLE_CHANNELS))).reshape(-1)

    def _cycle(self, u: float | None) -> Sample:
        """Take one sample, check it, then command the spool; None sends no command."""
        network = self._network
        network.pump_until(self._next)
        since = network.now()
        network.sync()
        if not network.wait_for(
            lambda: self._is_newer_than(since) or self._has_booted(), ANSWER_TIMEOUT
        ):
            self.missed += 1
        self._check_devices()
        sample = self._read(since)
        self._check(sample)
        if u is not None:
            self.valve.check_active()
            self.valve.spool_setpoint = u
        if self._recording is not None:
            self._recording.append_row((*sample, float(self._step_number)))
        self._next = max(self._next + self.period, since)
        return sample

    def _read(self, since: float) -> Sample:
        position = self._position
        return Sample(
            since - self._origin,
            position.position if position.is_valid else math.nan,
            position.speed,
            self._pressures[0].pressure,
            self._pressures[1].pressure,
            self.valve.spool_setpoint,
            self.valve.spool_position,
        )

    def _check_devices(self) -> None:
        """Notice a device that has booted.

        Raises:
            LimitError: one has.
        """
        for device, before, now in zip(
            self._devices, self._boot_ups, self._count_boot_ups(), strict=True
        ):
            if now != before:
                raise LimitError(f"{device.node} rebooted")

    def _check(self, sample: Sample) -> None:
        """Compare a sample with the limits.

        Raises:
            LimitError: it is beyond one.
        """
        limits = self._limits
        if limits is None:
            return
        check_sample(sample, limits)
        elapsed = self._network.now() - self._step_start
        if elapsed > limits.time:
            raise LimitError(f"time {elapsed:.1f} s is beyond its limit of {limits.time:g} s")

    def _is_newer_than(self, since: float) -> bool:
        return all(device.received_at > since for device in self._devices)

    def _has_booted(self) -> bool:
        return self._count_boot_ups() != self._boot_ups

    def _says_closed(self) -> bool:
        """Return True if the valve is in a state in which its spool follows nobody."""
        try:
            return self.valve.read_state() in _CLOSED
        except DriverError:
            return False

    def _count_boot_ups(self) -> tuple[int, ...]:
        return tuple(device.node.boot_ups for device in self._devices)


# Common parts of all steps of a commissioning, and the first steps.

APPROACH_TIME = 15.0
"""Longest time to a starting position [s]."""

PATIENCE = 0.3
"""Time that nodes have to show themselves [s]."""

REST = 0.3
"""Time with the valve closed between two motions [s]."""

_APPROACH_SPEED = 0.05
_APPROACH_GAIN = 4.0
_NEAR_ENOUGH = 2e-3


@dataclass
class Procedure:
    """The network, devices and settings that the steps share.

    Attributes:
        network: of the drivers.
        config: the bench as it should be.
        axis: the axis, with its data sheet.
        members: its nodes.
        rig: the drivers in step.
        dead_zone: spool position at which the valve opens, by the data sheet or as measured [-].
        creep: what is added to it while the piston does not move [-].
    """

    network: Network
    config: BenchConfig
    axis: CylinderConfig
    members: Members
    rig: Rig
    dead_zone: float = math.nan
    creep: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        if math.isnan(self.dead_zone):
            self.dead_zone = self.parameters.beta / self.parameters.full_opening

    @property
    def parameters(self) -> PlantParameters:
        """The data sheet of the axis."""
        return self.axis.parameters

    def go_to(self, target: float) -> None:
        """Bring the piston slowly to a position [m]."""
        full_speed = expected_speed(1.0, self.parameters)
        self.creep = 0.0

        def approach(distance: float) -> float:
            if abs(distance) < _NEAR_ENOUGH:
                return 0.0
            speed = min(_APPROACH_GAIN * abs(distance), _APPROACH_SPEED)
            # Grows until it moves, wherever the dead band really ends.
            self.creep = min(self.creep + 1e-4, 0.3) if distance else 0.0
            opening = self.dead_zone + speed / full_speed * (1.0 - self.dead_zone)
            return math.copysign(min(opening + 0.2 * self.creep, 0.9), distance)

        self.rig.move_to(target, approach, timeout=APPROACH_TIME)

    def force(self, trace: Recording) -> Any:  # noqa: ANN401 - a column of a structured array
        """Return the piston's force by its pressures, P_A A_A - P_B A_B [N]."""
        return trace[P_A] * self.parameters.A_A - trace[P_B] * self.parameters.A_B


def communication(procedure: Procedure, step: Step) -> StepResult:
    """Compare the nodes with bench and EDS files, and set them up.

    Raises nothing of its own: a device that cannot be set up raises a `DriverError`.
    """
    result = StepResult(step.kind)
    names = {node.node_id: node for node in procedure.members}
    differences = [
        difference
        for difference in comparison.compare(procedure.network, procedure.config, patience=PATIENCE)
        if difference.node_id in names
    ]
    foreign = [difference for difference in differences if difference.mend is comparison.Mend.NODE]
    settings = [
        difference for difference in differences if difference.mend is comparison.Mend.WRITE
    ]
    remapped = [difference for difference in settings if _is_mapping(difference)]
    result.findings += [_identity_finding(difference) for difference in foreign]
    result.findings += [
        Diagnosis("another PDO mapping", difference.what, "hil-bench check --bus --apply mends it")
        for difference in remapped
    ]
    result.notes += [difference.what for difference in settings if difference not in remapped]
    strangers = {difference.node_id for difference in foreign}
    result.measures += [
        Measure("nodes as configured", float(len(names) - len(strangers)), "nodes", low=len(names)),
        Measure("settings that differ from the EDS", float(len(settings)), ""),
    ]
    if sum(difference.is_missing for difference in foreign) == len(names):
        result.verdict, result.problem = Verdict.NOT_RUN, "no node answers"
        return result
    if foreign or remapped:
        result.verdict = Verdict.STOPPED
        result.problem = "a node is not as its EDS describes it; nothing was moved"
        return result
    procedure.rig.set_up()
    return result


def _is_mapping(difference: comparison.Difference) -> bool:
    """Return True if it is one of what a PDO carries."""
    return difference.key is not None and any(
        difference.key[0] in block for block in comparison.MAPPING
    )


def _identity_finding(difference: comparison.Difference) -> Diagnosis:
    if difference.key == comparison.REVISION:
        name = "wrong EDS revision"
    elif difference.key in {*comparison.IDENTITY, comparison.SERIAL_NUMBER}:
        name = "another device"
    else:
        name = "node missing" if difference.is_missing else "node not usable"
    mend = "look at the device, or take the EDS that belongs to it: hil-bench scan"
    return Diagnosis(name, difference.what, mend)
