"""The direction of the valve, and the responses to its steps."""

import math

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.commissioning import measures
from hil_bench.abilities.commissioning.measures import Curve, Diagnosis, Measure, StepResult
from hil_bench.abilities.commissioning.plan import SETTLING, Step, expected_speed, expected_travel
from hil_bench.abilities.commissioning.rig import REST, Procedure
from hil_bench.abilities.common.shown_units import display_unit
from hil_bench.outside.recording.channels import Recording
from hil_bench.plants.hydraulic_cylinder.model import PlantParameters
from hil_bench.plants.hydraulic_cylinder.quantities import P_A, P_B
from hil_bench.plants.hydraulic_cylinder.resolution import eigenfrequency

# Steps and sweeps in frequency: how fast valve and piston answer.


def steps(procedure: Procedure, step: Step) -> StepResult:
    """Open the valve by a step each way: how soon the spool is there, how fast the piston goes."""
    result = StepResult(step.kind)
    u, duration = step.values["opening"], step.values["duration"]
    parameters = procedure.parameters
    low, high = step.limits.position
    procedure.rig.enable()
    procedure.go_to(0.5 * (low + high) - 0.5 * expected_travel(step, parameters))

    def command(time: float) -> float:
        if time < REST:
            return 0.0
        if time < REST + duration:
            return u
        return -u if 2 * REST + duration <= time < 2 * REST + 2 * duration else 0.0

    trace = result.trace = procedure.rig.move(command, 3 * REST + 2 * duration)
    time = trace["time"]
    sheet, share = expected_speed(u, parameters), step.values["speed_tolerance"]
    for name, sign, start in (("extending", 1.0, REST), ("retracting", -1.0, 2 * REST + duration)):
        part = (time > start + 0.5 * duration) & (time <= start + duration)
        speed = sign * measures.slope(time[part], trace["position"][part])
        result.measures.append(
            Measure(f"speed, {name}", speed, "m/s", (1 - share) * sheet, (1 + share) * sheet)
        )
    first = time < REST + duration
    rise = measures.rise_time(
        time[first], trace["spool_setpoint"][first], trace["spool_position"][first]
    )
    result.measures += [
        Measure("spool: time to 63 %", rise, "s", high=step.values["rise_time"]),
        Measure("highest pressure", float(max(trace[P_A].max(), trace[P_B].max())), "Pa"),
        Measure("lowest pressure", float(min(trace[P_A].min(), trace[P_B].min())), "Pa"),
    ]
    return result


def chirp(procedure: Procedure, step: Step) -> StepResult:
    """Sweep a small sine on top of slow motion: the hydraulic mode's frequency and damping."""
    result = StepResult(step.kind)
    values, rig = step.values, procedure.rig
    u, duration, amplitude = values["opening"], values["duration"], values["amplitude"]
    start, end = values["start"], values["end"]
    low, high = step.limits.position
    rig.enable()
    procedure.go_to(0.5 * (low + high) - 0.5 * expected_travel(step, procedure.parameters))

    def command(time: float) -> float:
        since = time - SETTLING
        if since < 0.0:
            return u
        phase = 2.0 * math.pi * (start + 0.5 * (end - start) * since / duration) * since
        return u + amplitude * math.sin(phase)

    trace = result.trace = rig.move(command, SETTLING + duration)
    rig.move(lambda _time: 0.0, REST)
    swept = trace[trace["time"] >= SETTLING]
    band = (start, min(end, 0.4 / rig.period))
    # By the position: the sensor's own speed may be the mean of some time.
    spool, positions = (
        measures.resample(swept["time"], swept[name], rig.period)
        for name in ("spool_position", "position")
    )
    grid = rig.period * np.arange(len(positions), dtype=np.float64)
    speed = measures.derivative(positions, grid)
    measured = measures.undo_derivative(
        measures.frequency_response(spool, speed, rig.period, band), rig.period
    )
    mode = measures.fit_mode(measured)
    position = float(swept["position"].mean())
    sheet = eigenfrequency(procedure.axis, position)
    modulus = procedure.parameters.E * (mode.frequency / sheet) ** 2
    share = values["frequency_tolerance"]
    result.measures += [
        Measure("eigenfrequency", mode.frequency, "Hz", (1 - share) * sheet, (1 + share) * sheet),
        Measure("damping ratio", mode.damping, "", low=values["smallest_damping"]),
        Measure("effective bulk modulus", modulus * 1e-6, "MPa"),
        Measure("coherence, mean", float(measured.coherence.mean()), "", low=0.5),
    ]
    is_moved = not result.measures[-1].is_wrong  # else what was fitted is no response
    if is_moved and mode.frequency < (1 - share) * sheet:
        result.findings.append(_soft_oil(mode.frequency, sheet, modulus, procedure.parameters.E))
    result.curves += _bode(measured, mode)
    return result


def _soft_oil(frequency: float, sheet: float, modulus: float, expected: float) -> Diagnosis:
    return Diagnosis(
        "air in the oil",
        f"eigenfrequency {frequency:.1f} Hz where the data sheet gives {sheet:.1f} Hz: the oil is "
        f"as soft as {modulus * 1e-6:.0f} MPa, not {expected * 1e-6:.0f} MPa",
        "bleed the cylinder; soft hoses or a greater mass than the data sheet's look the same",
    )


def _bode(measured: measures.FrequencyResponse, mode: measures.Mode) -> list[Curve]:
    frequency, response = measured.frequency, measured.response
    model = mode.response(frequency)
    phase: npt.NDArray[np.float64] = np.degrees(np.unwrap(np.angle(response)))
    return [
        Curve(
            "Speed per spool: gain",
            "Frequency [Hz]",
            "Gain [dB of mm/s per %]",
            frequency,
            _decibels(response),
            frequency,
            _decibels(model),
            is_frequency=True,
        ),
        Curve(
            "Speed per spool: phase",
            "Frequency [Hz]",
            "Phase [deg]",
            frequency,
            phase,
            frequency,
            np.degrees(np.unwrap(np.angle(model))),
            is_frequency=True,
        ),
    ]


def _decibels(response: npt.NDArray[np.complex128]) -> npt.NDArray[np.float64]:
    """Return m/s per fraction of full opening as dB of mm/s per percent."""
    return np.asarray(20.0 * np.log10(np.maximum(np.abs(response) * 10.0, 1e-9)))


# The direction of the axis: the first motion, and the meaning of its signs.

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
    v = [measures.slope(time[part], trace["position"][part]) for part in (extending, retracting)]
    force = procedure.force(trace)
    change = float(force[extending].mean() - force[retracting].mean())
    spool = float(trace["spool_position"][extending].mean())
    noise = 3 * measures.noise(time[: len(time) // 20], trace["position"][: len(time) // 20])
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


_MOVED = 1e-3
"""Way of the piston on which no pressure stands still to the last digit [m]."""


def stuck_pressures(trace: Recording) -> list[Diagnosis]:
    """Return the pressure sensors that say the same in all samples of a motion."""
    way = float(np.ptp(trace["position"]))
    found = []
    for port in (P_A, P_B):
        if way < _MOVED or np.ptp(trace[port]) > 0.0:
            continue
        unit = display_unit("Pa")
        value = f"{unit.from_si(float(trace[port][0])):.4g} {unit.symbol}"
        shown = f"{value} in all {len(trace)} samples, while the position went {way * 1e3:.3g} mm"
        mend = f"look at the sensor of {port}, at what it maps into its PDO, and at its supply"
        found.append(Diagnosis("pressure sensor stuck", f"{port} is {shown}", mend))
    return found


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
