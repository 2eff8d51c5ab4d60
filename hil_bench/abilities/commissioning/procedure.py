"""Common parts of all steps of a commissioning, and the first steps."""

import math
from dataclasses import dataclass, field
from typing import Any

from hil_bench.abilities.commissioning import comparison
from hil_bench.abilities.commissioning.measures import Diagnosis, Measure, StepResult, Verdict
from hil_bench.abilities.commissioning.plan import Step, expected_speed
from hil_bench.abilities.commissioning.rig import Rig
from hil_bench.abilities.common.members import Members
from hil_bench.bench.configuration import BenchConfig
from hil_bench.outside.recording.channels import Recording
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_bench.plants.hydraulic_cylinder.model import PlantParameters
from hil_bench.plants.hydraulic_cylinder.quantities import P_A, P_B
from hil_drivers import Network

APPROACH_TIME = 15.0
"""Longest time to a starting position [s]."""

PATIENCE = 0.3
"""Time that nodes have to show themselves [s]."""

REST = 0.3
"""Time with the valve closed between two motions [s]."""

_APPROACH_SPEED = 0.05
_APPROACH_GAIN = 4.0
_NEAR_ENOUGH = 2e-3


def moving_mass(axis: CylinderConfig) -> float:
    """Return the mass that moves with the piston, that of a load included [kg]."""
    return axis.parameters.m + axis.options.load_mass


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
