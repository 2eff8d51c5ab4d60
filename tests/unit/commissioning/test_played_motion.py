"""Steps and ramps on a machine that is played: the numbers found are those it was made with.

Both sides are unequal throughout, so that none stands for the other.
"""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from hil_bench.abilities.commissioning.plan import SETTLING, Limits, Step, StepKind, expected_speed
from hil_bench.abilities.commissioning.responses import chirp, direction, steps, stuck_pressures
from hil_bench.abilities.commissioning.rig import Procedure
from hil_bench.abilities.commissioning.sweeps import Triangle, dead_band, leakage, ramp, sensors
from hil_bench.bench.configuration import load_config
from hil_bench.plants.hydraulic_cylinder.quantities import P_A, P_B
from hil_bench.plants.hydraulic_cylinder.resolution import eigenfrequency

PERIOD = 0.002  # [s]
EDGES, GAINS = (0.2, 0.1), (0.30, 0.20)  # extending and retracting: [-], [m/s]
COULOMB, VISCOUS, LOAD = 250.0, 900.0, 40.0  # [N], [N s/m], [N]
LAG = 0.01  # of the spool, a dead time [s]
LOW = 12e5  # pressure in chamber B [Pa]
LIMITS = Limits(position=(-0.15, 0.15), speed=0.4, pressure=(-1e5, 110e5), time=60.0)
TOLERANCES = {"speed_tolerance": 0.1, "rise_time": 0.05, "gain_tolerance": 0.2, "asymmetry": 0.3}
TOLERANCES |= {"friction_tolerance": 0.25, "dead_band_tolerance": 0.3, "zero": 0.02}


class Machine:
    """Moves with a speed of its own each way, against friction and a load."""

    period = PERIOD

    def __init__(self, parameters):
        self.parameters = parameters
        self.spring, self.mass = 0.0, parameters.m  # [N/m], [kg]
        self.mode = None  # eigenfrequency [rad/s] and damping ratio of one that swings
        self.show = dict  # what the sensors make of a trace

    def enable(self):
        pass

    def swing(self, command, duration):
        """Move as a mode of second order follows the spool, about mid-stroke."""
        omega, damping = self.mode
        fine = PERIOD / 20
        times = np.arange(0.0, duration, fine)
        speed = rate = place = 0.0
        rows = []
        for number, time in enumerate(times):
            setpoint = command(time)
            if number % 20 == 0:
                rows.append((time, setpoint, setpoint, speed, place))
            force = omega**2 * (GAINS[0] * setpoint - speed) - 2.0 * damping * omega * rate
            rate += fine * force
            speed += fine * rate
            place += fine * speed
        names = ("time", "spool_setpoint", "spool_position", "speed", "position")
        trace = np.array(rows, dtype=[(name, "f8") for name in names])
        trace["position"] -= trace["position"].mean()
        return trace

    def move(self, command, duration):
        if self.mode:
            return self.swing(command, duration)
        time = np.arange(0.0, duration, PERIOD)
        setpoint = np.array([command(t) for t in time])
        spool = np.array([command(t - LAG) for t in time])
        out = GAINS[0] * np.maximum(spool - EDGES[0], 0.0)
        speed = out - GAINS[1] * np.maximum(-spool - EDGES[1], 0.0)
        force = LOAD + np.sign(speed) * COULOMB + VISCOUS * speed
        position = np.cumsum(speed) * PERIOD
        force += self.mass * np.gradient(speed, time) + self.spring * position
        return self.show(
            {
                "time": time,
                "spool_setpoint": setpoint,
                "spool_position": spool,
                "speed": speed,
                "position": position,
                P_A: (force + LOW * self.parameters.A_B) / self.parameters.A_A,
                P_B: np.full_like(time, LOW),
            }
        )

    def watch(self, duration):
        return self.move(lambda _time: 0.0, duration)


@pytest.fixture
def measured():
    """Do a step of a plan; return its measures by name, with their limits."""
    axis = load_config().axes[0]
    procedure = SimpleNamespace(
        rig=Machine(axis.parameters), axis=axis, parameters=axis.parameters, dead_zone=0.0
    )
    measured_from = []
    procedure.go_to = measured_from.append
    procedure.force = lambda trace: Procedure.force(procedure, trace)

    def measure(do, kind, **values):
        result = do(procedure, Step(kind, LIMITS, TOLERANCES | values))
        measure.findings, measure.curves, measure.trace = (
            result.findings,
            result.curves,
            result.trace,
        )
        return {each.name: each for each in result.measures}

    measure.machine, measure.procedure = procedure.rig, procedure
    measure.begins = measured_from
    return measure


def test_each_way_of_a_step_has_its_speed_and_the_spool_its_time(measured):
    found = measured(steps, StepKind.STEPS, opening=0.5, duration=0.4)
    sheet = expected_speed(0.5, measured.machine.parameters)
    for way in ("extending", "retracting"):  # 10 % each side of the data sheet
        limits = found[f"speed, {way}"].low, found[f"speed, {way}"].high
        assert limits == pytest.approx((0.9 * sheet, 1.1 * sheet))
    assert found["speed, extending"].value == pytest.approx(0.30 * 0.3, rel=1e-3)
    assert found["speed, retracting"].value == pytest.approx(0.20 * 0.4, rel=1e-3)
    assert found["spool: time to 63 %"].value == pytest.approx(LAG, abs=PERIOD)
    assert found["spool: time to 63 %"].high == 0.05
    assert found["lowest pressure"].value <= LOW <= found["highest pressure"].value
    setpoint = measured.trace["spool_setpoint"]
    for sign in (1.0, -1.0):  # 0.4 s each way
        assert np.sum(setpoint == sign * 0.5) * PERIOD == pytest.approx(0.4, abs=2 * PERIOD)


def test_a_short_motion_each_way_tells_the_direction(measured):
    """The force turns by twice the friction of standing, and by that of both speeds."""
    found = measured(direction, StepKind.DIRECTION, opening=0.5, duration=0.3)
    speeds = 0.30 * 0.3, -0.20 * 0.4
    for sign, speed in zip(("positive", "negative"), speeds, strict=True):
        assert found[f"speed with {sign} set-point"].value == pytest.approx(speed, rel=1e-3)
    change = found["change of force between both"].value
    assert change == pytest.approx(2 * COULOMB + VISCOUS * (speeds[0] - speeds[1]), rel=1e-3)
    spool = found["spool with positive set-point"]
    assert (spool.low, spool.value, spool.high) == pytest.approx((0.45, 0.5, 0.55))


def standing(share):
    """The position stands, and the force changes by a share of the full one, or of friction."""

    def show(trace):
        p = load_config().axes[0].parameters
        full = p.P_S * p.mean_area if share > 0.2 else p.F_c
        force = 0.5 * share * full * np.sign(trace["spool_position"]) + LOW * p.A_B
        return trace | {"position": np.zeros_like(force), P_A: force / p.A_A}

    return show


@pytest.mark.parametrize(
    ("show", "found", "mend"),
    [
        (dict, [], ""),
        (
            lambda t: t | {"spool_position": -t["spool_position"]},
            ["valve inverted"],
            "invert the valve's set-point",
        ),
        (
            lambda t: t | {"spool_position": 0.49 * t["spool_position"]},
            ["valve does not follow"],
            "look at the valve's supply and enable",
        ),
        (lambda t: t | {"spool_position": 1.49 * t["spool_position"]}, [], ""),
        (
            lambda t: t | {"spool_position": 1.51 * t["spool_position"]},
            ["valve does not follow"],
            "look at the valve's supply and enable",
        ),
        (
            lambda t: t | {P_A: t[P_B], P_B: t[P_A]},
            ["pressure sensors swapped"],
            "exchange the sensors at A and B, or their node-IDs",
        ),
        (
            lambda t: t | {"position": -t["position"]},
            ["position sensor reversed"],
            "reverse the sensor's direction (0x6000 bit 3), or turn it round",
        ),
        (
            lambda t: t | {"position": -t["position"], P_A: t[P_B], P_B: t[P_A]},
            ["valve inverted"],
            "exchange the hoses at A and B, or invert the valve's set-point",
        ),
        (lambda t: t | {"position": np.abs(t["spool_position"]) * t["time"]}, [], ""),
        (standing(0.41), ["axis blocked"], "look for what holds the piston"),
        (
            standing(0.39),
            ["position sensor stuck"],
            "look at the position sensor, its magnet or coupling",
        ),
        (
            standing(0.11),
            ["position sensor stuck"],
            "look at the position sensor, its magnet or coupling",
        ),
        (
            standing(0.09),
            ["no supply pressure"],
            "switch the supply on, look at shut-off valves and at the valve's dead band",
        ),
    ],
)
def test_signs_and_standstill_name_what_is_wrong(measured, show, found, mend):
    measured.machine.show = show
    result = measured(direction, StepKind.DIRECTION, opening=0.5, duration=0.3)
    assert [each.name for each in measured.findings] == found
    assert [each.mend for each in measured.findings] == [mend] * len(found)
    limits = {name: (each.low, each.high) for name, each in result.items()}
    assert limits["speed with positive set-point"] == (1e-3, math.inf)
    assert limits["speed with negative set-point"] == (-math.inf, -1e-3)
    assert limits["change of force between both"] == (0.0, math.inf)


def test_the_evidence_of_a_reversed_sensor_has_both_signs(measured):
    """Speeds of 90 and -80 mm/s; twice the friction of 250 N and 900 N s/m of both."""
    measured.machine.show = lambda t: t | {"position": -t["position"]}
    measured(direction, StepKind.DIRECTION, opening=0.5, duration=0.3)
    (finding,) = measured.findings
    assert finding.evidence == (
        "speed -85.0 mm/s, change of P_A A_A - P_B A_B +653 N for a positive set-point against a "
        "negative one"
    )


@pytest.mark.parametrize(
    ("way", "still", "ports"),
    [(0.99e-3, (P_A, P_B), []), (1e-3, (P_A, P_B), [P_A, P_B]), (1.0, (P_B,), [P_B]), (1, (), [])],
)
def test_a_pressure_that_stands_still_to_the_last_digit_is_stuck(way, still, ports):
    trace = np.zeros(5, dtype=[(name, "f8") for name in ("position", P_A, P_B)])
    trace["position"][2] = way
    for port in (P_A, P_B):
        trace[port] = 42.5e5 if port in still else 42.5e5 + np.arange(5)
    found = stuck_pressures(trace)
    shown = f"is 42.5 bar in all 5 samples, while the position went {1e3 * way:.3g} mm"
    assert [each.evidence for each in found] == [f"{port} {shown}" for port in ports]


DRIFT, RATES, NOISES = 2e-4, {P_A: -3e3, P_B: 5e3}, {P_A: 4e3, P_B: 7e3}  # [m/s], [Pa/s], [Pa]
ANY = -math.inf, math.inf


@pytest.fixture
def drifting(measured):
    """Sensors at standstill that drift and rattle."""

    def show(trace):
        time = trace["time"]
        turn = np.resize([1.0, -1.0, -1.0, 1.0], len(time))  # neither a mean nor a slope
        shown = {port: 30e5 + RATES[port] * time + NOISES[port] * turn for port in RATES}
        position = 0.02 + DRIFT * time + 5e-6 * turn
        return trace | shown | {"position": position, "spool_position": 0.03 + 0.0 * time}

    measured.machine.show = show
    return measured


def test_sensors_at_standstill_show_range_noise_and_drift(drifting):
    values = {"duration": 4.0, "position_noise": 1e-5, "position_drift": 1e-3}
    values |= {"pressure_noise": 5e3, "pressure_drift": 4e3}
    found = drifting(sensors, StepKind.SENSORS, **values)
    p = load_config().axes[0].parameters
    middle = 0.5 * (4.0 - PERIOD)  # of the times of the samples
    expected = {
        "position": (0.02 + DRIFT * middle, -p.h, p.h),
        "position noise": (5e-6, -math.inf, 1e-5),
        "position drift": (DRIFT, -1e-3, 1e-3),
        "spool at rest": (0.03, -0.05, 0.05),
    }
    for port, rate in RATES.items():
        expected[port] = 30e5 + rate * middle, -2e5, 1.1 * p.P_S
        expected[f"{port} noise"] = NOISES[port], -math.inf, 5e3
        expected[f"{port} drift"] = rate, -4e3, 4e3
    assert found.keys() == expected.keys()
    for name, (value, low, high) in expected.items():
        assert found[name].value == pytest.approx(value, rel=1e-6), name
        assert (found[name].low, found[name].high) == (low, high), name
    assert {name for name, each in found.items() if each.is_wrong} == {
        f"{P_B} noise",
        f"{P_B} drift",
    }


@pytest.mark.parametrize(
    ("drift", "rate", "wrong"),
    [
        (1e-3, 1e4, ""),
        (1e-3, 4e3, f"{P_B} drift 0.05 bar/s"),
        (1e-4, 4e3, f"position drift 0.2 mm/s, {P_B} drift 0.05 bar/s"),
    ],
)
def test_what_leaves_a_closed_chamber_is_its_drift_by_the_oils_modulus(
    drifting, drift, rate, wrong
):
    values = {"opening": 0.3, "motion_time": 0.2, "duration": 4.0}
    values |= {"position_drift": drift, "pressure_drift": rate}
    found = drifting(leakage, StepKind.LEAKAGE, **values)
    p = load_config().axes[0].parameters
    middle = 0.5 * (4.0 - PERIOD)
    place = 0.02 + DRIFT * middle
    volumes = {P_A: p.V_A0 + p.A_A * place, P_B: p.V_B0 - p.A_B * place}  # [m³]
    expected = {"position drift": (DRIFT, -drift, drift)}
    for port, volume in volumes.items():
        expected[f"{port} at standstill"] = 30e5 + RATES[port] * middle, *ANY
        expected[f"{port} drift"] = RATES[port], -rate, rate
        flow = -RATES[port] * volume / p.E * 1e6 * 60.0  # [cm³/min]
        expected[f"flow out of chamber {port[-1]}"] = flow, *ANY
    assert found.keys() == expected.keys()
    for name, (value, low, high) in expected.items():
        assert found[name].value == pytest.approx(value, rel=1e-6), name
        assert (found[name].low, found[name].high) == (low, high), name
    names = [each.name for each in drifting.findings]
    assert (names, [each.evidence for each in drifting.findings]) == (
        (["leakage"], [wrong]) if wrong else ([], [])
    )


def test_a_triangle_goes_to_both_peaks():
    triangle = Triangle(0.6, 8.0)
    times = np.linspace(-1.0, 9.0, 401)
    corners = [0.0, 2.0, 4.0, 6.0, 8.0], [0.0, 0.6, 0.0, -0.6, 0.0]
    assert [triangle(time) for time in times] == pytest.approx(np.interp(times, *corners))


def test_the_approach_is_slow_and_creeps_until_it_moves():
    """50 mm/s at most, a quarter of a second from its end; 0.02 % more a sample, up to 6 %."""
    axis = load_config().axes[0]
    moves = []
    rig = SimpleNamespace(move_to=lambda *given, timeout: moves.append((*given, timeout)))
    procedure = Procedure(None, None, axis, None, rig)
    assert procedure.dead_zone == pytest.approx(0.3 / 1.3)  # Table I
    procedure.dead_zone = 0.2
    for _ in range(2):  # the second one begins anew
        procedure.go_to(0.07)
        target, approach, timeout = moves.pop()
        assert (target, timeout) == (0.07, 15.0)
        assert approach(0.00199) == approach(-0.00199) == 0.0
        full = expected_speed(1.0, axis.parameters)
        for number, distance in enumerate([0.002, -0.01, 0.0125, 0.1] + [-1.0] * 3500, 1):
            opening = 0.2 + min(0.05, 4.0 * abs(distance)) / full * 0.8
            opening += 0.2 * min(1e-4 * number, 0.3)
            assert approach(distance) == pytest.approx(math.copysign(opening, distance))
    procedure.dead_zone = 0.89
    procedure.go_to(0.0)
    assert [moves[0][1](1.0) for _ in range(100)][-1] == pytest.approx(0.9)


def test_a_ramp_finds_gains_and_friction_again(measured):
    found = measured(ramp, StepKind.RAMP, opening=0.8, duration=8.0)
    assert found["speed per percent, extending"].value == pytest.approx(0.0030, rel=0.02)
    assert found["speed per percent, retracting"].value == pytest.approx(0.0020, rel=0.02)
    assert found["asymmetry"].value == pytest.approx(0.1 / 0.25, rel=0.05)
    assert found["Coulomb friction"].value == pytest.approx(COULOMB, rel=0.02)
    assert found["viscous friction"].value == pytest.approx(VISCOUS, rel=0.02)
    assert found["load force"].value == pytest.approx(LOAD, rel=0.05)
    # Table I: the valve opens 1 mm behind an overlap of 0.3 mm, so the sheet's gain begins there.
    sheet = expected_speed(1.0, load_config().axes[0].parameters) / (1.0 - 0.3 / 1.3) * 0.01
    for name in ("extending", "retracting"):
        gain = found[f"speed per percent, {name}"]
        assert (gain.low, gain.high) == pytest.approx((0.8 * sheet, 1.2 * sheet))
    friction = next(each for each in measured.curves if each.title == "Friction")
    assert (friction.x_label, friction.y_label) == ("Speed [mm/s]", "Force [kN]")
    assert friction.x.max() == pytest.approx(1e3 * 0.30 * 0.6, rel=0.02)  # of 0.8 behind 0.2
    assert friction.y.max() == pytest.approx(1e-3 * (COULOMB + VISCOUS * 0.18 + LOAD), rel=0.05)


FRICTION = load_config().axes[0].parameters.F_c


@pytest.mark.parametrize(
    ("loads", "low", "high"),
    [
        ({}, -FRICTION, FRICTION),
        ({"load_n": -500.0}, -500 - FRICTION - 100, -500 + FRICTION + 100),  # a fifth of it
        ({"load_n": 9000.0}, 9000 - FRICTION - 1800, 9000 + FRICTION + 1800),
        ({"load_series_s_n": [[0.0, 9000.0]]}, -math.inf, math.inf),
    ],
)
def test_the_load_is_judged_by_the_data_sheet(measured, loads, low, high):
    measured.procedure.axis = load_config(tables={"plant": {"axis1": loads}}).axes[0]
    found = measured(ramp, StepKind.RAMP, opening=0.8, duration=8.0)["load force"]
    assert (found.low, found.high) == pytest.approx((low, high))
    is_right = low <= LOAD <= high
    assert [each.name for each in measured.findings] == (
        [] if is_right else ["another load, or a pressure that is off"]
    )


def test_a_load_that_nobody_knows_is_given_room(measured):
    measured.procedure.axis = load_config(tables={"plant": {"axis1": {"load_n": 9000.0}}}).axes[0]
    values = {"opening": 0.8, "duration": 8.0, "load_tolerance": 9000.0}
    found = measured(ramp, StepKind.RAMP, **values)["load force"]
    assert (found.low, found.high) == pytest.approx((0.0, 18000.0))
    assert not measured.findings


def test_another_load_is_said_as_a_pressure_that_is_off(measured):
    """9000 N less 40 N on A_A: for a P_A that is too low."""
    sheet = load_config(tables={"plant": {"axis1": {"load_n": 9000.0}}}).axes[0]
    measured.procedure.axis = sheet
    measured(ramp, StepKind.RAMP, opening=0.8, duration=8.0)
    apart = (9000.0 - LOAD) / sheet.parameters.A_A / 1e5  # bar
    (finding,) = measured.findings
    assert f"; a P_A that is {apart:.3g} bar too low shows the same" in finding.evidence


def test_a_spring_and_a_mass_of_the_data_sheet_are_no_friction(measured):
    loads = {"load_spring_n_mm": 20.0, "load_mass_kg": 400.0, "load_slope_deg": 0.0}
    sheet = load_config(tables={"plant": {"axis1": loads}}).axes[0]
    measured.procedure.axis = sheet
    measured.machine.spring, measured.machine.mass = 20e3, sheet.parameters.m + 400.0
    found = measured(ramp, StepKind.RAMP, opening=0.8, duration=8.0)
    assert found["Coulomb friction"].value == pytest.approx(COULOMB, rel=0.02)
    assert found["viscous friction"].value == pytest.approx(VISCOUS, rel=0.02)


def test_the_mass_of_a_load_slows_the_oscillation(measured):
    own = measured.procedure.axis
    loads = {"load_mass_kg": 3.0 * own.parameters.m}
    heavy = load_config(tables={"plant": {"axis1": loads}}).axes[0]
    assert eigenfrequency(heavy, 0.0) == pytest.approx(eigenfrequency(own, 0.0) / 2.0)


def test_friction_is_judged_by_the_data_sheet(measured):
    parameters = load_config().axes[0].parameters
    found = measured(ramp, StepKind.RAMP, opening=0.8, duration=8.0)
    for name, sheet in (("Coulomb", parameters.F_c), ("viscous", parameters.sigma)):
        measure = found[f"{name} friction"]
        assert (measure.low, measure.high) == pytest.approx((0.75 * sheet, 1.25 * sheet))


@pytest.mark.parametrize("share", [0.8, 1.1])
def test_a_chirp_finds_a_mode_and_what_it_says_of_the_oil(measured, share):
    """The machine swings at a share of the data sheet's frequency: E is as its square."""
    sheet = eigenfrequency(load_config().axes[0], 0.0)
    measured.machine.mode = (2.0 * math.pi * share * sheet, 0.1)
    values = {"opening": 0.3, "amplitude": 0.05, "start": 20.0, "end": 120.0, "duration": 4.0}
    values |= {"frequency_tolerance": 0.15, "smallest_damping": 0.05}
    found = measured(chirp, StepKind.CHIRP, **values)
    # Half the way, of 4 s and the settling before, short of the middle of -0.15 to 0.15 m.
    way = (4.0 + SETTLING) * expected_speed(0.3, load_config().axes[0].parameters)
    assert measured.begins == [pytest.approx(-0.5 * way)]
    frequency = found["eigenfrequency"]
    assert frequency.value == pytest.approx(share * sheet, rel=0.02)
    # At mid-stroke, where it ends up, the sheet's frequency hardly changes.
    assert (frequency.low, frequency.high) == pytest.approx((0.85 * sheet, 1.15 * sheet), rel=0.01)
    assert found["damping ratio"].value == pytest.approx(0.1, rel=0.1)
    assert found["damping ratio"].low == 0.05
    modulus = load_config().axes[0].parameters.E * 1e-6 * share**2
    assert found["effective bulk modulus"].value == pytest.approx(modulus, rel=0.04)
    assert found["coherence, mean"].value > 0.95
    assert [curve.is_frequency for curve in measured.curves] == [True, True]
    soft = [finding.name for finding in measured.findings]
    assert soft == (["air in the oil"] if share < 0.85 else [])


def test_the_oil_in_hoses_is_no_air(measured):
    """Far below its quarter wave a shut hose is a spring beside that of its chamber."""
    hoses = {"line_model": "waves", "load_mass_kg": 380.0}
    for side in "ab":
        hoses[f"line_{side}_length_m"], hoses[f"line_{side}_inner_mm"] = 1.0, 35.0
        hoses[f"line_{side}_modulus_mpa"] = 100.0
    axis = measured.procedure.axis = load_config(tables={"plant": {"axis1": hoses}}).axes[0]
    p, hose = axis.parameters, math.pi / 4.0 * 0.035**2 * 1.0 / 100e6  # [m³/Pa]
    lumped, stiff = (
        math.sqrt(p.A_A**2 / (p.V_A0 / p.E + c) + p.A_B**2 / (p.V_B0 / p.E + c))
        / (2.0 * math.pi * math.sqrt(p.m + 380.0))
        for c in (hose, 0.0)
    )
    assert lumped < 0.85 * stiff  # who forgets the hoses finds air
    measured.machine.mode = (2.0 * math.pi * lumped, 0.1)
    values = {"opening": 0.3, "amplitude": 0.05, "start": 5.0, "end": 60.0, "duration": 4.0}
    values |= {"frequency_tolerance": 0.15, "smallest_damping": 0.05}
    found = measured(chirp, StepKind.CHIRP, **values)["eigenfrequency"]
    assert (found.low, found.high) == pytest.approx((0.85 * lumped, 1.15 * lumped), rel=0.03)
    assert not measured.findings


def test_a_sweep_through_zero_finds_both_edges(measured):
    found = measured(dead_band, StepKind.DEAD_BAND, opening=0.6, duration=6.0)
    assert found["edge for extending"].value == pytest.approx(0.2, abs=0.005)
    assert found["edge for retracting"].value == pytest.approx(-0.1, abs=0.005)
    assert found["valve zero"].value == pytest.approx(0.05, abs=0.005)
    assert found["dead band"].value == pytest.approx(0.3, abs=0.01)
    sheet = 2.0 * 0.3 / 1.3  # Table I, of both sides
    assert (found["dead band"].low, found["dead band"].high) == pytest.approx(
        (0.7 * sheet, 1.3 * sheet)
    )
