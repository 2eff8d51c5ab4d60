"""A twin that joins a machine at any moment follows it, and only a machine that is like it."""

import math
import random
from copy import deepcopy

import pytest
from support.built_in_nodes import NODES
from support.machine_life import BY_EVENT, SYNCHRONOUS, commanded_blindly, motion, whole_life

from hil_bench.abilities.shadow.twin import Shadow, fit_limits, widening
from hil_bench.bench.configuration import load_config

BUILT_IN = load_config()
HORIZON = 0.2
LISTENED = 0.75
"""Time that each twin listens: joining and settling take 0.12 s, so two windows at least [s]."""

SHEET_VALVE = NODES.replace("node_id = 1 }", "node_id = 1, full_opening_mm = 1.3 }")
"""The nodes of the built-in bench: 100 % stays 1.3 mm, whatever the spool's overlap is."""


@pytest.fixture
def write_config(load_bench):
    """Return what loads a machine from the keys of its axis."""

    def load(keys, objects=""):
        nodes = SHEET_VALVE.replace("1.3 }", f"1.3, objects = {{ {objects} }} }}")
        return load_bench(f"[plant.axis1]\n{keys}\n{nodes}")

    return load


def follow(frames, config=BUILT_IN):
    shadow = Shadow(config, horizon=HORIZON)
    for message in frames:
        shadow.take(message)
    shadow.finish()
    return shadow


def exceeded(windows, config=BUILT_IN):
    """Return the quantities that were too much in one of the windows."""
    limits = fit_limits(config)["axis1"]
    return {
        quantity
        for window in windows
        for quantity, residual in window.residuals.items()
        if residual.count and residual.rms > limits[quantity] * widening(window.lateness)
    }


def test_the_noise_of_a_sensor_widens_the_limit_of_its_quantity_alone():
    # Three standard deviations of 2 bar beside the model's own residual: they are independent.
    nodes = {"valve": {"profile": "valve_408", "node_id": 1}}
    nodes["pressure"] = {"profile": "pressure_404", "node_id": 2, "source": "P_B"}
    quiet = fit_limits(load_config(tables={"nodes": nodes}))["axis1"]
    nodes["pressure"]["chain"] = {"noise_rms_bar": 2}
    noisy = fit_limits(load_config(tables={"nodes": nodes}))["axis1"]
    assert noisy.pop("P_B") == pytest.approx(math.hypot(quiet.pop("P_B"), 3.0 * 2e5))
    assert noisy == quiet


def check_that_it_is_followed(pdos, begin):
    frames = whole_life(pdos).part(begin, LISTENED)
    shadow = follow(frames)
    missing = shadow.axes["axis1"].missing(shadow.now)
    assert shadow.windows, f"joined at {begin:.3f} s: waits for {missing}"
    assert exceeded(shadow.windows) == set(), f"joined at {begin:.3f} s"


@pytest.mark.parametrize("pdos", [SYNCHRONOUS, BY_EVENT], ids=["sync", "event"])
@pytest.mark.parametrize(
    "part", ["boot", "motion", "steps", "silent controller", "fault", "after the fault", "disabled"]
)
def test_an_equal_twin_follows_in_whatever_state_it_finds_the_machine(pdos, part):
    begin = whole_life(pdos).begins[part]
    check_that_it_is_followed(pdos, begin + (0.0 if part == "boot" else 0.0137))


@pytest.mark.long  # 200 twins
@pytest.mark.parametrize("pdos", [SYNCHRONOUS, BY_EVENT], ids=["sync", "event"])
def test_an_equal_twin_follows_whenever_it_joins(pdos):
    life = whole_life(pdos)
    begin, end = 0.0, life.frames[-1].timestamp - LISTENED
    while begin < end:
        check_that_it_is_followed(pdos, begin)
        begin += 0.0437


@pytest.mark.parametrize(
    ("pdos", "keys", "shows_in"),
    [
        # Where the piston turns round, its friction does: 1200 N more on 48.5 cm² are 2.5 bar,
        # half of it in each chamber.
        (SYNCHRONOUS, "coulomb_friction_n = 1200\nstatic_friction_n = 1800", {"P_A", "P_B"}),
        # The pressures swing at 71 Hz after each step, here at 60 Hz: they are out of step soon.
        (BY_EVENT, "bulk_modulus_mpa = 70", {"P_A", "P_B"}),
        # 50 % of 1.3 mm less 0.36 mm in place of 0.3 mm of overlap open 0.29 in place of 0.35 mm:
        # 17 % of 0.1 m/s for 0.2 s are 3.4 mm.
        (SYNCHRONOUS, "spool_overlap_mm = 0.36", {"position"}),
        # 0.02 l/min for each of some 48 bar run out of A for 0.2 s: 3.2 cm³, and with the stiffness
        # of 1200 cm³ of oil of 100 MPa 2.7 bar if the piston stood still.
        (BY_EVENT, "external_leakage_a_l_min_bar = 0.02", {"P_A", "P_B"}),
    ],
    ids=["friction", "bulk modulus", "dead zone", "leakage"],
)
def test_a_machine_with_another_parameter_is_found(write_config, pdos, keys, shows_in):
    life = motion(write_config(keys), pdos)
    found = exceeded(follow(life.part(life.begins["motion"])).windows)
    assert found & shows_in


def test_a_ramp_goes_on_from_where_the_machines_spool_is(write_config):
    """The valve's ramp takes 1 s from 0 to 100 %, so the twin's would be 50 % behind for 0.5 s."""
    config = write_config("", '"0x6330" = 1, "0x6331.01" = 1000')
    life = motion(config, BY_EVENT)
    shadow = follow(life.part(life.begins["motion"] + 0.1), config)
    assert exceeded(shadow.windows, config) == set()


def test_a_valve_that_is_kept_disabled_is_followed_though_it_is_commanded():
    """Its enable input is off, which no frame shows; the same control word comes on and on."""
    frames = commanded_blindly(BUILT_IN, lambda bench: bench.faults.disable("valve"))
    shadow = follow([m for m in frames if m.timestamp > 0.3])
    assert len(shadow.windows) >= 3
    assert exceeded(shadow.windows) == set()
    assert not shadow.axes["axis1"].corrections  # it was so when the twin joined


@pytest.fixture(scope="module")
def undisturbed():
    return commanded_blindly(BUILT_IN, lambda _bench: None)


@pytest.fixture
def frames(undisturbed):
    """Those of a sound machine, which a test may change."""
    return deepcopy(undisturbed)


def at(time, act):
    """Return what does something to a bench at a time [s]."""

    def prepare(bench):
        bench.observers.append(lambda now: act(bench) if abs(now - time) < 1e-4 else None)

    return prepare


@pytest.mark.parametrize(
    ("happens", "state"),
    [
        (lambda bench: bench.faults.disable("valve"), "DISABLED"),
        (lambda bench: bench.faults.reset("valve"), "INIT"),
    ],
    ids=["enable input", "reset of its own"],
)
def test_what_no_frame_announces_is_taken_over_and_not_judged(happens, state):
    shadow = follow(commanded_blindly(BUILT_IN, at(0.7, happens), duration=1.6))
    assert {window.begin < 0.7 for window in shadow.windows} == {True, False}
    assert exceeded(shadow.windows) == set()
    corrections = shadow.axes["axis1"].corrections
    assert [(c.twin, c.machine) for c in corrections] == (
        [] if state == "INIT" else [("ACTIVE", state)]
    )


def test_a_set_point_from_before_the_twin_listened_is_waited_for(frames):
    silent = [m for m in frames if m.timestamp > 0.3 and m.arbitration_id != 0x201]
    shadow = follow(silent)
    assert not shadow.windows
    assert shadow.axes["axis1"].missing(shadow.now) == {
        "set-point": "not heard, and the valve is ACTIVE"
    }


def test_a_local_command_is_not_on_the_bus(frames):
    for message in frames:
        if message.arbitration_id == 0x181:
            message.data[0] |= 0x10  # status word, bit 4: the local control word rules (CiA 408)
    shadow = follow(frames)
    assert not shadow.windows
    assert shadow.axes["axis1"].missing(shadow.now) == {
        "set-point": "not on the bus: the valve is under local control"
    }


def test_a_sensor_without_a_valid_value_is_waited_for():
    frames = commanded_blindly(
        BUILT_IN, at(0.6, lambda bench: bench.faults.break_wire("pressure_a"))
    )
    shadow = follow(frames)
    assert shadow.windows
    assert all(window.end < 0.61 for window in shadow.windows)
    assert shadow.axes["axis1"].missing(shadow.now) == {"P_A": "not valid, says the device"}


def test_a_device_that_falls_silent_is_waited_for():
    frames = commanded_blindly(
        BUILT_IN, at(0.6, lambda bench: bench.faults.silence("position")), duration=2.2
    )
    shadow = follow(frames)
    assert all(window.end < 0.61 for window in shadow.windows)
    (why,) = shadow.axes["axis1"].missing(shadow.now).values()
    assert why == f"silent for {shadow.now - 0.6:.1f} s"


def test_values_that_no_sensor_measures_do_no_harm(frames):
    """Everything from a bus is hostile: any bytes in the devices' frames, and any time stamps."""
    anything = random.Random(7)  # noqa: S311 - no secrets
    for message in frames:
        if message.timestamp > 0.3 and anything.random() < 0.2:
            message.data = bytearray(anything.randbytes(len(message.data)))
        if anything.random() < 0.01:
            message.timestamp += anything.choice((-1.0, 1.0, 20.0))
    shadow = follow(frames)
    assert shadow.frames == len(frames)
