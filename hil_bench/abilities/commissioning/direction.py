"""The direction of the axis: the first motion, and the meaning of its signs."""

import numpy as np

from hil_bench.abilities.commissioning import estimation
from hil_bench.abilities.commissioning.measures import Diagnosis, Measure, StepResult
from hil_bench.abilities.commissioning.plan import Step
from hil_bench.abilities.commissioning.procedure import REST, Procedure
from hil_bench.plants.hydraulic_cylinder.model import PlantParameters

STANDSTILL = 1e-3
"""Speed below which a piston counts as standing [m/s]."""


def direction(procedure: Procedure, step: Step) -> StepResult:
    """Open the valve shortly each way, and see which way the piston and its pressures go.

    Two signs tell four cases: that of the speed, and that of the change of P_A A_A - P_B A_B from
    one way to the other, which friction makes that of the true speed.
    """
    result = StepResult(step.kind)
    u, duration = step.values["opening"], step.values["duration"]
    rig = procedure.rig
    rig.enable()

    def pulses(time: float) -> float:
        if time < duration:
            return u
        return -u if duration + REST <= time < 2 * duration + REST else 0.0

    trace = result.trace = rig.move(pulses, 2 * duration + 2 * REST)
    time = trace["time"]
    extending = (time > 0.5 * duration) & (time <= duration)
    retracting = (time > 1.5 * duration + REST) & (time <= 2 * duration + REST)
    v = [estimation.slope(time[part], trace["position"][part]) for part in (extending, retracting)]
    force = procedure.force(trace)
    change = float(force[extending].mean() - force[retracting].mean())
    spool = float(trace["spool_position"][extending].mean())
    noise = 3 * estimation.noise(time[: len(time) // 20], trace["position"][: len(time) // 20])
    moved = float(np.ptp(trace["position"]))
    result.measures += [
        Measure("speed with positive set-point", v[0], "m/s", low=STANDSTILL),
        Measure("speed with negative set-point", v[1], "m/s", high=-STANDSTILL),
        Measure("change of force between both", change, "N", low=0.0),
        Measure("spool with positive set-point", spool, "-", u - 0.05, u + 0.05),
    ]
    stands = max(map(abs, v)) < STANDSTILL or moved < max(noise, 1e-4)
    if stands or v[0] * v[1] < 0.0:  # the same way twice has no direction to judge
        result.findings += _findings(procedure, v[0] - v[1], change, spool / u, stands=stands)
    return result


def _findings(
    procedure: Procedure, v: float, change: float, follows: float, *, stands: bool
) -> list[Diagnosis]:
    """Return the findings from the signs of the motion; see `direction`."""
    evidence = (
        f"speed {0.5e3 * v:+z.1f} mm/s, change of P_A A_A - P_B A_B {change:+.0f} N for a positive "
        "set-point against a negative one"
    )
    if -1.5 < follows < -0.5:
        what = f"the spool goes to {100 * follows:.0f} % of its set-point: {evidence}"
        return [Diagnosis("valve inverted", what, "invert the valve's set-point")]
    if not 0.5 < follows < 1.5:
        what = f"the spool is at {100 * follows:.0f} % of its set-point"
        return [Diagnosis("valve does not follow", what, "look at the valve's supply and enable")]
    if stands:
        return [_why_it_stands(procedure.parameters, change, evidence)]
    if v > 0 and change > 0:
        return []
    name, mend = _WRONG_WAYS[v > 0, change > 0]
    return [Diagnosis(name, evidence, mend)]


_WRONG_WAYS = {
    (True, False): (
        "pressure sensors swapped",
        "exchange the sensors at A and B, or their node-IDs",
    ),
    (False, False): (
        "valve inverted",
        "exchange the hoses at A and B, or invert the valve's set-point",
    ),
    (False, True): (
        "position sensor reversed",
        "reverse the sensor's direction (0x6000 bit 3), or turn it round",
    ),
}
"""What is wrong and how to mend it, by whether the speed is positive and whether the force is."""


def _why_it_stands(parameters: PlantParameters, change: float, evidence: str) -> Diagnosis:
    """Return why the position does not change though the spool moves."""
    if abs(change) > 0.4 * parameters.P_S * parameters.mean_area:
        mend = "look for what holds the piston"
        return Diagnosis("axis blocked", f"full pressure and no motion: {evidence}", mend)
    if abs(change) < 0.1 * parameters.F_c:
        mend = "switch the supply on, look at shut-off valves and at the valve's dead band"
        return Diagnosis("no supply pressure", f"no motion and no force: {evidence}", mend)
    return Diagnosis(
        "position sensor stuck",
        f"the pressures show a moving piston, the position stands still: {evidence}",
        "look at the position sensor, its magnet or coupling",
    )
