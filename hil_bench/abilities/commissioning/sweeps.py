"""Measurements at standstill and in slow sweeps of the spool."""

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.commissioning import measures
from hil_bench.abilities.commissioning.measures import Curve, Diagnosis, Measure, StepResult
from hil_bench.abilities.commissioning.plan import Step, expected_speed, expected_travel
from hil_bench.abilities.commissioning.rig import REST, Procedure
from hil_bench.abilities.common.shown_units import display_unit
from hil_bench.outside.recording.channels import Recording
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_bench.plants.hydraulic_cylinder.model.load import LoadSeries
from hil_bench.plants.hydraulic_cylinder.quantities import P_A, P_B, PORTS

# Slow sweeps of the spool: dead band, speed against spool, friction against speed.


class Triangle:
    """A set-point that goes to a peak and back, then to the other peak and back.

    Args:
        amplitude: peak [-].
        duration: of the whole [s].
    """

    def __init__(self, amplitude: float, duration: float) -> None:
        self._amplitude = amplitude
        self._duration = duration

    def __call__(self, time: float) -> float:
        """Return the set-point at a time [s]; 0 after the whole."""
        if not 0.0 <= time < self._duration:
            return 0.0
        phase = time / self._duration
        sign = 1.0 if phase < 0.5 else -1.0
        part = 2.0 * (phase % 0.5)
        return sign * self._amplitude * (1.0 - abs(2.0 * part - 1.0))


def _sweep(procedure: Procedure, step: Step) -> Recording:
    """Sweep the spool slowly both ways about the middle of the limits, and return the samples."""
    low, high = step.limits.position
    u, duration = step.values["opening"], step.values["duration"]
    rig = procedure.rig
    rig.enable()
    procedure.go_to(0.5 * (low + high) - 0.5 * expected_travel(step, procedure.parameters))
    return rig.move(Triangle(u, duration), duration + REST)


def dead_band(procedure: Procedure, step: Step) -> StepResult:
    """Sweep the spool slowly through zero: where the piston begins to move each way."""
    result = StepResult(step.kind)
    trace = result.trace = _sweep(procedure, step)
    spool, speed = trace["spool_position"], trace["speed"]
    band = measures.dead_band(spool, speed)
    sheet = 2.0 * procedure.parameters.beta / procedure.parameters.full_opening
    share = step.values["dead_band_tolerance"]
    zero = step.values["zero"]
    result.measures += [
        Measure("valve zero", band.zero, "-", -zero, zero),
        Measure("dead band", band.width, "-", (1 - share) * sheet, (1 + share) * sheet),
        Measure("edge for extending", band.positive, "-"),
        Measure("edge for retracting", band.negative, "-"),
    ]
    if 0.0 < band.width < 1.8:
        procedure.dead_zone = 0.5 * band.width
    edges = np.array([band.negative, band.positive]) * 100.0
    result.curves.append(replace(_speed_curve(spool, speed), fit_x=edges, fit_y=np.zeros(2)))
    return result


def _speed_curve(spool: npt.NDArray[np.float64], speed: npt.NDArray[np.float64]) -> Curve:
    """Return the speed over the spool's position, in the units that people are shown."""
    unit = display_unit("m/s")
    return Curve(
        "Speed against spool position",
        "Spool [%]",
        f"Speed [{unit.symbol}]",
        spool * 100.0,
        speed / unit.factor,
    )


def ramp(procedure: Procedure, step: Step) -> StepResult:
    """Ramp the spool slowly both ways: speed against spool, friction against speed."""
    result = StepResult(step.kind)
    trace = result.trace = _sweep(procedure, step)
    parameters, values = procedure.parameters, step.values
    spool, speed = trace["spool_position"], trace["speed"]
    # What the oil's oscillation takes to move the mass is no friction, nor how a load changes.
    moving_mass = procedure.axis.parameters.m + procedure.axis.options.load_mass  # [kg]
    inertia = moving_mass * measures.derivative(speed, trace["time"])
    load = _sheet_load(procedure.axis, trace)
    force = procedure.force(trace) - inertia - (load - load.mean())
    band = measures.dead_band(spool, speed)
    sheet = expected_speed(1.0, parameters) / (1.0 - parameters.beta / parameters.full_opening)
    share = values["gain_tolerance"]
    limits = ((1 - share) * sheet * 0.01, (1 + share) * sheet * 0.01)
    mean = 0.5 * (band.gain_positive + band.gain_negative)
    asymmetry = (band.gain_positive - band.gain_negative) / mean
    slowest = max(3.0 * parameters.chi, 0.15 * float(np.abs(speed).max()))
    found = measures.friction(speed, force, slowest=min(slowest, 0.5 * np.abs(speed).max()))
    spread = values["friction_tolerance"]
    result.measures += [
        Measure("speed per percent, extending", 0.01 * band.gain_positive, "m/s", *limits),
        Measure("speed per percent, retracting", 0.01 * band.gain_negative, "m/s", *limits),
        Measure("asymmetry", asymmetry, "-", -values["asymmetry"], values["asymmetry"]),
        Measure(
            "Coulomb friction",
            found.coulomb,
            "N",
            (1 - spread) * parameters.F_c,
            (1 + spread) * parameters.F_c,
        ),
        Measure(
            "viscous friction",
            found.viscous,
            "N s/m",
            (1 - spread) * parameters.sigma,
            (1 + spread) * parameters.sigma,
        ),
        Measure("load force", found.load, "N", *_load_limits(procedure.axis, load, step)),
    ]
    if result.measures[-1].is_wrong:
        result.findings.append(_other_load(result.measures[-1], parameters.A_A))
    line = np.array([speed.min(), -slowest, math.nan, slowest, speed.max()])
    fit = found.load + np.sign(line) * found.coulomb + found.viscous * line
    at, by = display_unit("m/s"), display_unit("N")
    result.curves += [
        _speed_curve(spool, speed),
        Curve(
            "Friction",
            f"Speed [{at.symbol}]",
            f"Force [{by.symbol}]",
            speed / at.factor,
            force / by.factor,
            line / at.factor,
            fit / by.factor,
        ),
    ]
    return result


def _sheet_load(axis: CylinderConfig, trace: Recording) -> npt.NDArray[np.float64]:
    """Return the load that the data sheet gives at each sample [N], as at time 0."""
    return np.array([axis.options.load_at(x) for x in trace["position"].tolist()])


def _load_limits(
    axis: CylinderConfig, load: npt.NDArray[np.float64], step: Step
) -> tuple[float, float]:
    """Return the limits of the load [N]: none where it is a course of time."""
    if any(isinstance(each, LoadSeries) for each in axis.options.loads):
        return -math.inf, math.inf
    mean = float(load.mean())
    room = step.values.get("load_tolerance", axis.parameters.F_c + 0.2 * abs(mean))
    return mean - room, mean + room


def _other_load(load: Measure, area: float) -> Diagnosis:
    unit = display_unit("Pa")
    apart = unit.from_si((load.value - 0.5 * (load.low + load.high)) / area)
    evidence = (
        f"load force {load.text()}, where {load.range_text()} is right by the data sheet; a P_A "
        f"that is {abs(apart):.3g} {unit.symbol} too {'high' if apart > 0.0 else 'low'} "
        "shows the same"
    )
    mend = "compare both pressures with a gauge, and the load with bench.toml"
    return Diagnosis("another load, or a pressure that is off", evidence, mend)


# The axis at standstill: what its sensors show, and what leaks.


def sensors(procedure: Procedure, step: Step) -> StepResult:
    """Look at the sensors at standstill, the valve closed: range, noise, drift."""
    result = StepResult(step.kind)
    values, parameters = step.values, procedure.parameters
    trace = result.trace = procedure.rig.watch(values["duration"])
    time = trace["time"]
    position = trace["position"]
    half = parameters.h
    result.measures += [
        Measure("position", float(position.mean()), "m", -half, half),
        Measure(
            "position noise", measures.noise(time, position), "m", high=values["position_noise"]
        ),
        _drift("position drift", measures.slope(time, position), "m/s", values["position_drift"]),
    ]
    for name in PORTS:
        pressure = trace[name]
        result.measures += [
            Measure(name, float(pressure.mean()), "Pa", -2e5, 1.1 * parameters.P_S),
            Measure(
                f"{name} noise", measures.noise(time, pressure), "Pa", high=values["pressure_noise"]
            ),
            _drift(
                f"{name} drift", measures.slope(time, pressure), "Pa/s", values["pressure_drift"]
            ),
        ]
    result.measures.append(
        Measure("spool at rest", float(np.mean(trace["spool_position"])), "-", -0.05, 0.05)
    )
    return result


def _drift(name: str, value: float, unit: str, limit: float) -> Measure:
    return Measure(name, value, unit, -limit, limit)


def leakage(procedure: Procedure, step: Step) -> StepResult:
    """Move a little, close the valve, and see whether pressures and position stay."""
    result = StepResult(step.kind)
    values, rig = step.values, procedure.rig
    rig.enable()
    procedure.go_to(0.5 * sum(step.limits.position))
    u, moving = values["opening"], values["motion_time"]
    rig.move(lambda time: u if time < moving else 0.0, moving + REST)
    trace = result.trace = rig.move(lambda _time: 0.0, values["duration"])
    time = trace["time"]
    parameters = procedure.parameters
    position = float(trace["position"].mean())
    drift, limit = measures.slope(time, trace["position"]), values["position_drift"]
    result.measures.append(Measure("position drift", drift, "m/s", -limit, limit))
    volumes = {
        P_A: parameters.V_A0 + parameters.A_A * position,
        P_B: parameters.V_B0 - parameters.A_B * position,
    }
    limit = values["pressure_drift"]
    for name, volume in volumes.items():
        rate = measures.slope(time, trace[name])
        result.measures += [
            Measure(f"{name} at standstill", float(trace[name].mean()), "Pa"),
            Measure(f"{name} drift", rate, "Pa/s", -limit, limit),
            Measure(
                f"flow out of chamber {name[-1]}", -rate * volume / parameters.E * 60e6, "cm³/min"
            ),
        ]
    wrong = [f"{measure.name} {measure.text()}" for measure in result.measures if measure.is_wrong]
    if wrong:
        mend = (
            "look at the piston seal, the valve's edges and the fittings; a position sensor that "
            "drifts looks the same"
        )
        result.findings.append(Diagnosis("leakage", ", ".join(wrong), mend))
    return result
