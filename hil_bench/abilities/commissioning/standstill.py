"""The axis at standstill: what its sensors show, and what leaks."""

import numpy as np

from hil_bench.abilities.commissioning import estimation
from hil_bench.abilities.commissioning.measures import Diagnosis, Measure, StepResult
from hil_bench.abilities.commissioning.plan import Step
from hil_bench.abilities.commissioning.procedure import REST, Procedure
from hil_bench.plants.hydraulic_cylinder.quantities import P_A, P_B, PORTS


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
            "position noise", estimation.noise(time, position), "m", high=values["position_noise"]
        ),
        _drift("position drift", estimation.slope(time, position), "m/s", values["position_drift"]),
    ]
    for name in PORTS:
        pressure = trace[name]
        result.measures += [
            Measure(name, float(pressure.mean()), "Pa", -2e5, 1.1 * parameters.P_S),
            Measure(
                f"{name} noise",
                estimation.noise(time, pressure),
                "Pa",
                high=values["pressure_noise"],
            ),
            _drift(
                f"{name} drift", estimation.slope(time, pressure), "Pa/s", values["pressure_drift"]
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
    drift, limit = estimation.slope(time, trace["position"]), values["position_drift"]
    result.measures.append(Measure("position drift", drift, "m/s", -limit, limit))
    volumes = {
        P_A: parameters.V_A0 + parameters.A_A * position,
        P_B: parameters.V_B0 - parameters.A_B * position,
    }
    limit = values["pressure_drift"]
    for name, volume in volumes.items():
        rate = estimation.slope(time, trace[name])
        result.measures += [
            Measure(f"{name} at standstill", float(trace[name].mean()), "Pa"),
            Measure(f"{name} drift", rate, "Pa/s", -limit, limit),
            Measure(
                f"flow out of chamber {name[-1]}",
                -rate * volume / parameters.E * 60e6,
                "cm³/min",
            ),
        ]
    if not all(measure.is_right for measure in result.measures):
        evidence = ", ".join(f"{m.name} {m.text()}" for m in result.measures if not m.is_right)
        mend = "look at the piston seal, the valve's edges and the fittings"
        result.findings.append(Diagnosis("leakage", evidence, mend))
    return result
