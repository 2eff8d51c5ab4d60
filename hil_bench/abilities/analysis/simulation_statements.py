"""Sections IV-B and IV-C: what the paper reads from its simulations, checked."""

import cmath
import math
from collections.abc import Iterator

import numpy as np

from hil_bench.abilities.analysis.frequency_response import ChirpRun, ResponseEstimate
from hil_bench.abilities.analysis.linearisation import Response, linearise_full, linearise_reduced
from hil_bench.abilities.analysis.model_statements import (
    RESONANCE_BAND,
    PaperRuns,
    Statement,
    Verdict,
)
from hil_bench.abilities.analysis.operating_point import find_operating_point
from hil_bench.abilities.analysis.simulation import Signal
from hil_bench.outside.recording.channels import Recording
from hil_bench.plants.hydraulic_cylinder.model import PlantOptions, PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.stability import largest_euler_step


def simulation_statements(runs: PaperRuns) -> list[Statement]:
    """Return the statements of sections IV-B and IV-C."""
    return [
        *_solver(runs.parameters),
        *_responses(runs),
        *_excitation(runs),
        *_velocities(runs),
        *_load_pressures(runs),
        *_transients(runs),
    ]


def _solver(parameters: PlantParameters) -> Iterator[Statement]:
    dt, pole = 1e-4, linearise_reduced(parameters).poles[0]
    # A step of forward Euler multiplies a mode by 1 + s dt: that is the mode log(1 + s dt) / dt.
    seen = cmath.log(1.0 + pole * dt) / dt
    yield Statement(
        "IV-B",
        "“Forward-Euler integration with a fixed step (0.0001).”",
        f"It takes ζ of the hydraulic mode from {-pole.real / abs(pole):.4f} to "
        f"{-seen.real / abs(seen):.4f}, and is stable at standstill up to "
        f"{largest_euler_step(parameters, PlantOptions.paper()):.4g} s only.",
        Verdict.CORRECTED,
    )


def _responses(runs: PaperRuns) -> Iterator[Statement]:
    full, full_low, reduced, reduced_low = (run.estimate for run in runs.chirps)
    peaks = [estimate.peak(*RESONANCE_BAND) for estimate in (full, full_low, reduced, reduced_low)]
    resonance = peaks[0][0]
    rises = [estimate.gain_at(resonance) - estimate.gain_at(2.0) for estimate in (full, full_low)]
    free = runs.frictionless.estimate
    yield Statement(
        "IV-B, fig. 5",
        "“For both models the low inputs do not excite the hydraulic-related resonance peak.”",
        f"Full model at {resonance:.1f} Hz, over the gain at 2 Hz: {rises[0]:+.1f} dB at α, "
        f"{rises[1]:+.1f} dB at 0.3 α, where a flat hump of "
        f"{peaks[1][1] - full_low.gain_at(2.0):+.1f} dB at {peaks[1][0]:.0f} Hz remains "
        f"({peaks[3][0]:.0f} Hz in the reduced model). It is friction that holds the piston: with "
        f"F_c = F_s = 0 the reduced model rises by "
        f"{free.gain_at(free.peak(*RESONANCE_BAND)[0]) - free.gain_at(2.0):+.1f} dB at 0.3 α.",
        Verdict.HOLDS,
    )
    yield _resonance_shift(runs, peaks[0][0], peaks[2][0])
    yield _roll_off(runs.parameters, full, reduced)


def _resonance_shift(runs: PaperRuns, full: float, reduced: float) -> Statement:
    frozen = runs.frozen.estimate.peak(*RESONANCE_BAND)[0]
    position = position_at(runs.chirps[0], full)
    expected = eigenfrequency_at(runs.parameters, position) / (2.0 * math.pi)
    middle = runs.parameters.omega_c / (2.0 * math.pi)
    return Statement(
        "IV-B, fig. 5",
        "“The resonance peak of the reduced model is also shifted to the lower frequencies.”",
        f"Peaks at α: full {full:.1f} Hz, reduced {reduced:.1f} Hz. It is the full model that "
        f"moves, up: a single rod drifts out under a symmetric chirp and passes the resonance at "
        f"x = {position * 1e3:.0f} mm, where the smaller volume raises the eigenfrequency from "
        f"{middle:.1f} to {expected:.1f} Hz. With volumes held constant the full model peaks at "
        f"{frozen:.1f} Hz. A longer chirp drifts further and shifts more.",
        Verdict.CORRECTED,
    )


def position_at(run: ChirpRun, frequency: float) -> float:
    """Return the piston's position when a chirp passes a frequency [m]."""
    row = round(run.chirp.time_of(frequency) / run.setup.dt)
    return float(run.recording["x"][row])


def eigenfrequency_at(parameters: PlantParameters, position: float) -> float:
    """Return sqrt(E / m (A_A² / V_A + A_B² / V_B)) of the full model at a position [rad/s]."""
    A_A, A_B = parameters.A_A, parameters.A_B  # noqa: N806 - the chambers' names
    stiffness = A_A**2 / (parameters.V_A0 + A_A * position)
    stiffness += A_B**2 / (parameters.V_B0 - A_B * position)
    return math.sqrt(parameters.E * stiffness / parameters.m)


def _roll_off(
    parameters: PlantParameters, full: ResponseEstimate, reduced: ResponseEstimate
) -> Statement:
    ends = (250.0, 550.0)
    damper = PlantOptions.paper().tanh_gain * parameters.F_s + parameters.sigma
    slopes = [
        (estimate.gain_at(ends[1]) - estimate.gain_at(ends[0])) / math.log10(ends[1] / ends[0])
        for estimate in (reduced, full)
    ]
    phase = math.degrees(
        cmath.phase(reduced.response[int(np.argmin(abs(reduced.frequency - 500)))])
    )
    lag = 90.0 + math.degrees(math.atan(2.0 * math.pi * 500.0 * parameters.m / damper))
    return Statement(
        "IV-B, fig. 5",
        "At higher frequencies the reduced model has an “inherently lower, -40 dB per decade, "
        "decrease”.",
        f"Lower, yes: {slopes[0]:.0f} dB per decade from {ends[0]:g} to {ends[1]:g} Hz, the full "
        f"model {slopes[1]:.0f}. But -40 is the slope of (18). In the simulation the motion is so "
        f"small there that tanh(400 v) acts as a damper of {damper:.2g} N s/m: the reduced model "
        f"falls off as one of first order, with a phase of -{lag:.0f}° at 500 Hz ({phase:.0f}° "
        "with forward Euler).",
        Verdict.FAILS,
    )


def _excitation(runs: PaperRuns) -> Iterator[Statement]:
    parameters = runs.parameters
    low, high = (float(pair.full_order["z"].max()) for pair in runs.trajectories)
    yield Statement(
        "IV-C",
        "The low amplitude, 0.4 mm, “is close to the dead-zone size β”.",
        f"β = {parameters.beta * 1e3:g} mm; the orifice opens to z = {low * 1e3:.2f} mm, "
        f"{100.0 * low / parameters.alpha:.0f} % of α.",
        Verdict.HOLDS,
    )
    yield Statement(
        "IV-C",
        "The high amplitude, 1 mm, “corresponds to the saturated orifice state”.",
        f"The orifice opens to z = {high * 1e3:.2f} mm; by (2) it saturates at u = α + β = "
        f"{parameters.full_opening * 1e3:g} mm.",
        Verdict.FAILS,
    )


def _velocities(runs: PaperRuns) -> Iterator[Statement]:
    low, high = runs.trajectories
    agreement = [
        float(np.corrcoef(pair.full_order["v"], pair.reduced["v"])[0, 1]) for pair in (low, high)
    ]
    v_full, v_reduced = high.full_order["v"], high.reduced["v"]
    yield Statement(
        "IV-C, fig. 6",
        "“The velocity patterns of both models coincide well with each other.”",
        f"1 mm: correlation {agreement[1]:.3f}; {v_full.max() * 1e3:+.1f} and "
        f"{v_full.min() * 1e3:+.1f} mm/s against ±{v_reduced.max() * 1e3:.1f} mm/s. 0.4 mm: the "
        f"envelopes do ({low.full_order['v'].max() * 1e3:.1f} against "
        f"{low.reduced['v'].max() * 1e3:.1f} mm/s), the oscillations inside run out of step "
        f"(correlation {agreement[0]:.2f}).",
        Verdict.CORRECTED,
    )
    shares = [float(np.mean(np.abs(pair.full_order["v"]) < 2e-3)) for pair in (low, high)]
    dead = [2.0 / math.pi * math.asin(runs.parameters.beta / u) for u in (4e-4, 1e-3)]
    yield Statement(
        "IV-C, fig. 6",
        "“Zero velocity regions corresponding to the DCV dead-zone.”",
        f"|v| < 2 mm/s for {100.0 * shares[0]:.0f} % and {100.0 * shares[1]:.0f} % of the time at "
        f"0.4 and 1 mm; |u| < β for {100.0 * dead[0]:.0f} % and {100.0 * dead[1]:.0f} %.",
        Verdict.HOLDS,
    )


def _load_pressures(runs: PaperRuns) -> Iterator[Statement]:
    high, rods = runs.trajectories[1], runs.double_rod
    out, back = (find_operating_point(runs.parameters, spool_position=u) for u in (1e-3, -1e-3))
    steady = [point.load_pressure / 1e5 for point in (out, back)]
    apart = float(np.abs(rods.full_order["P_L"] - rods.reduced["P_L"]).max())
    unlike = float(np.abs(high.full_order["P_L"] - high.reduced["P_L"]).max())
    yield Statement(
        "IV-C, fig. 6",
        "“The load pressure trajectories are quite different in both, transient oscillations and "
        "steady-state locations.”",
        f"Mean P_L {high.full_order['P_L'].mean() / 1e5:.2f} bar against "
        f"{high.reduced['P_L'].mean() / 1e5:.2f} bar. Force balance makes it so: P_A A_A = P_B A_B "
        f"+ f leaves P_L = {steady[0]:.2f} bar out and {steady[1]:.2f} bar back at |u| = 1 mm, "
        f"where the reduced model has ±{high.reduced['P_L'][_crest(high.reduced)] / 1e5:.2f} bar. "
        f"With equal areas and constant volumes the two differ by {apart / 1e5:.2f} bar at the "
        f"most, instead of {unlike / 1e5:.2f} bar.",
        Verdict.HOLDS,
    )
    frequencies = [
        dominant_frequency(high.full_order, *window) for window in ((0.55, 0.85), (5.6, 5.9))
    ]
    places = [
        float(np.interp(t, high.full_order["time"], high.full_order["x"])) for t in (0.7, 5.75)
    ]
    yield Statement(
        "IV-C, fig. 6",
        "The differing oscillations come from “averaging of the orifice and continuity equations”.",
        f"In part: on the way back the full model rings at {frequencies[1]:.0f} Hz instead of "
        f"{frequencies[0]:.0f} Hz and larger, because it restarts at x = {places[1] * 1e3:.0f} mm "
        f"(out: {places[0] * 1e3:.0f} mm), beyond the stroke, with chamber B at its smallest.",
        Verdict.CORRECTED,
    )


def _crest(run: Recording) -> int:
    """Return the row at which a quarter of a period of 10 s is over."""
    return int(np.argmin(np.abs(run["time"] - 2.5)))


def _transients(runs: PaperRuns) -> Iterator[Statement]:
    low, high = (pair.full_order for pair in runs.trajectories)
    lead = phase_lead(high, 0.55, 0.85)
    mode = dominant_frequency(high, 0.55, 0.85) * 2.0 * math.pi
    expected = math.degrees(math.atan2(runs.parameters.m * mode, runs.parameters.sigma))
    yield Statement(
        "IV-C, fig. 6",
        "“Transient oscillations of both states in the anti-phase.”",
        f"The load pressure leads the velocity by {lead:.0f}°: nearly a quarter of a period, as "
        f"(17) has it (m s + σ leads by {expected:.0f}° at {mode / (2.0 * math.pi):.0f} Hz). "
        "In anti-phase the portraits would be lines, not ellipses.",
        Verdict.FAILS,
    )
    creeping = find_operating_point(runs.parameters, spool_position=4e-4)
    point_mode = linearise_full(runs.parameters, creeping).hydraulic_mode or (math.nan, math.nan)
    yield Statement(
        "IV-C, fig. 6",
        "After fast transients the trajectory is “a non-oscillating pattern … in case of the "
        "higher excitation amplitude”.",
        f"Ripple of the velocity from 1.5 to 4 s at 1 mm: {ripple(high, 1.5, 4.0) * 1e3:.3f} mm/s. "
        f"At 0.4 mm it never settles ({ripple(low, 2.0, 3.0) * 1e3:.0f} mm/s): the steady motion "
        f"at u = 0.4 mm, {creeping.velocity * 1e3:.1f} mm/s, has ζ = {point_mode[1]:.3f} and is "
        "unstable, because the friction curve falls there.",
        Verdict.HOLDS,
    )


def ripple(run: Recording, start: float, end: float) -> float:
    """Return half of the velocity's swing about its trend over a time span [m/s].

    The trend is a polynomial of the fifth degree.
    """
    part = run[(run["time"] >= start) & (run["time"] <= end)]
    return 0.5 * float(np.ptp(_without_trend(part["time"], part["v"], 5)))


def phase_lead(run: Recording, start: float, end: float) -> float:
    """Return by how much the load pressure leads the velocity at their main oscillation [deg]."""
    pressure, velocity, _ = _spectra(run, start, end)
    line = int(np.argmax(np.abs(velocity)))
    return math.degrees(cmath.phase(complex(pressure[line] / velocity[line])))


def dominant_frequency(run: Recording, start: float, end: float) -> float:
    """Return the frequency of the velocity's main oscillation over a time span [Hz]."""
    _, velocity, frequencies = _spectra(run, start, end)
    return float(frequencies[int(np.argmax(np.abs(velocity)))])


def _spectra(run: Recording, start: float, end: float) -> tuple[Response, Response, Signal]:
    part = run[(run["time"] >= start) & (run["time"] <= end)]
    time, window = part["time"], np.hanning(len(part))
    count = 8 * len(part)  # zeros behind: lines between the lines
    pressure, velocity = (
        np.fft.rfft(window * _without_trend(time, part[name], 2), count) for name in ("P_L", "v")
    )
    lines = np.fft.rfftfreq(count, float(time[1] - time[0])).astype(np.float64)
    return pressure, velocity, lines


def _without_trend(time: Signal, values: Signal, degree: int) -> Signal:
    centred = time - time.mean()
    return np.asarray(values - np.polyval(np.polyfit(centred, values, degree), centred))
