"""The analyses of the linear models and of the static valve, as studies."""

import math

import numpy as np

from hil_bench.abilities.analysis import linearisation
from hil_bench.abilities.analysis.figures import (
    ResponseCurve,
    draw_flow_pressure,
    draw_responses,
    draw_root_locus,
)
from hil_bench.abilities.analysis.frequency_response import decibel
from hil_bench.abilities.analysis.operating_point import flow_pressure_curves
from hil_bench.abilities.analysis.root_locus import root_locus
from hil_bench.abilities.analysis.steady_motion import OperatingPoint
from hil_bench.abilities.analysis.study import (
    VELOCITY_PER_OPENING,
    Fact,
    Study,
    make_table,
    response_table,
)
from hil_bench.abilities.common.figure_style import BLUE, RED
from hil_bench.outside.recording.channels import Channel
from hil_bench.plants.hydraulic_cylinder.model import PlantOptions, PlantParameters


def linearisation_study(
    parameters: PlantParameters, point: OperatingPoint, options: PlantOptions
) -> Study:
    """Return both models, linearised about one operating point of the full-order model."""
    full = linearisation.linearise_full(parameters, point, options)
    load_pressure = (point.pressure_a * parameters.A_A - point.pressure_b * parameters.A_B) / (
        parameters.mean_area
    )
    reduced = linearisation.linearise_with_valve(
        parameters, orifice_state=point.orifice_state, load_pressure=load_pressure
    )
    frequencies = np.geomspace(1.0, 600.0, 400)
    velocity = full.response(
        frequencies, linearisation.Input.SPOOL_SETPOINT, linearisation.Output.VELOCITY
    )
    curves = [
        ResponseCurve(
            "reduced, eq. (24), without spool", frequencies, reduced.response(frequencies), RED
        )
    ]
    if velocity.any():
        curves.insert(0, ResponseCurve("full-order, with spool", frequencies, velocity, BLUE))
    return Study(
        title="Linearisation about an operating point",
        facts=[
            *_reduced_facts(parameters, point, load_pressure, reduced),
            *_full_facts(full),
        ],
        tables={"linearisation": response_table(curves)},
        figures={
            "linearisation": lambda: draw_responses(
                curves,
                unit=VELOCITY_PER_OPENING,
                title=f"Linearisation at {point.velocity * 1e3:.4g} mm/s",
            )
        },
    )


def _reduced_facts(
    parameters: PlantParameters,
    point: OperatingPoint,
    load_pressure: float,
    with_valve: linearisation.SecondOrderSystem,
) -> list[Fact]:
    plain = linearisation.linearise_reduced(parameters)
    facts = [
        Fact("reduced: eigenfrequency omega_c (19)", plain.eigenfrequency, "rad/s"),
        Fact("reduced: eigenfrequency omega_c (19)", plain.eigenfrequency / (2.0 * math.pi), "Hz"),
        Fact("reduced: damping ratio zeta (20)", plain.damping_ratio, "-"),
        Fact("reduced: pole of G (18)", plain.poles[0], "rad/s"),
        Fact("reduced: pole of G (18)", plain.poles[1], "rad/s"),
    ]
    for form in linearisation.CoefficientForm:
        flow = linearisation.linearise_orifice(
            parameters,
            orifice_state=point.orifice_state,
            load_pressure=load_pressure,
            form=form,
        )
        facts += [
            Fact(f"reduced: flow gain C_q (21), {form}", flow.flow_gain, "m²/s"),
            Fact(
                f"reduced: flow-pressure coefficient C_qp (22), {form}",
                flow.flow_pressure_coefficient,
                "m³/(s Pa)",
            ),
        ]
    return [
        *facts,
        Fact("reduced with valve: eigenfrequency (24)", with_valve.eigenfrequency, "rad/s"),
        Fact("reduced with valve: damping ratio (24)", with_valve.damping_ratio, "-"),
    ]


def _full_facts(full: linearisation.FullLinearisation) -> list[Fact]:
    point, mode = full.operating_point, full.hydraulic_mode
    facts = [
        Fact("full-order: position", point.position, "m"),
        Fact("full-order: velocity", point.velocity, "m/s"),
        Fact("full-order: spool position", point.spool_position, "m"),
        Fact("full-order: orifice state", point.orifice_state, "m"),
        Fact("full-order: pressure P_A", point.pressure_a, "Pa"),
        Fact("full-order: pressure P_B", point.pressure_b, "Pa"),
    ]
    facts += [Fact("full-order: pole", complex(pole), "rad/s") for pole in full.poles]
    zeros = full.zeros(linearisation.Input.SPOOL_SETPOINT, linearisation.Output.VELOCITY)
    facts += [Fact("full-order: zero, set-point to velocity", complex(z), "rad/s") for z in zeros]
    if mode is not None:
        facts += [
            Fact("full-order: eigenfrequency", float(mode[0]), "rad/s"),
            Fact("full-order: damping ratio", float(mode[1]), "-"),
        ]
    return facts


def root_locus_study(parameters: PlantParameters, *, name: str = "root-locus") -> Study:
    """Return the root locus of k G(s) / s, and how the spool moves its limit."""
    locus, with_spool = root_locus(parameters), root_locus(parameters, with_spool=True)
    columns = {Channel("k", "m²/s"): locus.gains}
    for number, branch in enumerate(locus.poles.T, start=1):
        columns[Channel(f"pole_{number}_real", "rad/s")] = branch.real
        columns[Channel(f"pole_{number}_imaginary", "rad/s")] = branch.imag
    return Study(
        title="Root locus of k G(s) / s",
        facts=[
            *(Fact("pole of the open loop", complex(p), "rad/s") for p in locus.open_loop_poles),
            Fact("critical gain", locus.critical_gain, "m²/s"),
            Fact("frequency at the critical gain", locus.critical_frequency, "rad/s"),
            Fact("critical gain with the spool's lag", with_spool.critical_gain, "m²/s"),
            Fact("frequency there", with_spool.critical_frequency, "rad/s"),
        ],
        tables={name: make_table(columns)},
        figures={
            name: lambda: draw_root_locus(locus, title="Root locus of $k\\,G(s)\\,s^{-1}$"),
        },
    )


def flow_pressure_study(parameters: PlantParameters, *, name: str = "flow-pressure") -> Study:
    """Return the static flow-pressure curves, eq. (14)."""
    curves = flow_pressure_curves(parameters)
    columns = {Channel("P_L", "Pa"): curves.load_pressure}
    for state, flow in zip(curves.orifice_states, curves.flow, strict=True):
        columns[Channel(f"Q_L at z = {state * 1e3:.3g} mm", "m³/s")] = flow
    return Study(
        title="Static flow-pressure curves",
        facts=[
            Fact("valve flow coefficient K", parameters.K, "m²/(s sqrt(Pa))"),
            Fact("orifice state, fully open", float(curves.orifice_states[-1]), "m"),
            Fact("load flow there, no load", float(curves.flow[-1, 0]), "m³/s"),
            Fact("load pressure without flow", float(curves.load_pressure[-1]), "Pa"),
        ],
        tables={name: make_table(columns)},
        figures={
            name: lambda: draw_flow_pressure(curves, title="Static load flow over load pressure")
        },
    )


def operating_points_study(
    parameters: PlantParameters,
    *,
    name: str = "frequency-response-linear",
) -> Study:
    """Return eq. (24) at the paper's four points: 5 and 95 % of valve opening and supply."""
    frequencies = np.geomspace(1.0, 1000.0, 400)
    supply = parameters.P_S - parameters.P_T
    curves, facts = [], []
    for opening, style in ((0.05, "--"), (0.95, "-")):
        for pressure, colour in ((0.05, BLUE), (0.95, RED)):
            system = linearisation.linearise_with_valve(
                parameters,
                orifice_state=opening * parameters.alpha,
                load_pressure=pressure * supply,
            )
            label = f"z = {opening:g} alpha, P_L = {pressure:g} P_S"
            drawn = f"$z = {opening:g}\\,\\alpha$, $P_L = {pressure:g}\\,P_S$"
            curves.append(
                ResponseCurve(drawn, frequencies, system.response(frequencies), colour, style)
            )
            facts += [
                Fact(f"{label}: gain", float(decibel(np.array(system.gain + 0j))), "dB of (m/s)/m"),
                Fact(f"{label}: eigenfrequency", system.eigenfrequency, "rad/s"),
                Fact(f"{label}: damping ratio", system.damping_ratio, "-"),
            ]
    return Study(
        title="Linear frequency responses, eq. (24)",
        facts=facts,
        tables={name: response_table(curves)},
        figures={
            name: lambda: draw_responses(
                curves,
                unit=VELOCITY_PER_OPENING,
                title="Orifice state to velocity, linearised, eq. (24)",
            )
        },
    )
