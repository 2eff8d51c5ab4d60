# ruff: noqa: E501 - a mistake and its message on one line are easier to compare
"""What the verbs refuse; what they do is in tests/bench/test_faults.py."""

import math

import numpy as np
import pytest
from support import fault_verbs

from hil_bench import ConfigError, Faults, VirtualBench, load_config
from hil_bench.abilities.faults.checks import BrokenReading
from hil_bench.abilities.faults.commands import BeginFault
from hil_bench.abilities.faults.effects import Broken, Frozen, Lag, Noisy, Shifted, Slowed
from hil_bench.abilities.faults.points import PLANTS
from hil_bench.bench.assembly import build_bench
from hil_bench.devices.measurement.low_pass import normal_numbers, random_stream


@pytest.fixture(scope="module")
def faults():
    return build_bench(load_config()).part(Faults)


@pytest.mark.parametrize(
    ("verb", "arguments", "message"),
    [
        ("freeze", ("pressure_x",), 'there is no sensor "pressure_x"; give one of pressure_a, pressure_b, position'),
        ("freeze", ("valve",), 'there is no sensor "valve"; give one of pressure_a, pressure_b, position'),
        ("stick", ("position",), 'there is no valve "position"; give one of valve'),
        ("slow", ("axis1", 0.1), 'there is no sensor or valve "axis1"; give one of pressure_a, pressure_b, position, valve'),
        ("silence", ("axis1",), 'there is no node "axis1"; give one of valve, pressure_a, pressure_b, position'),
        ("drop_supply", ("valve", 1e5), 'there is no axis "valve"; give one of axis1'),
        ("drop_supply", ("axis1", 100e5), "drop_supply axis1: 100 bar is not below the 100 bar of the supply; give less"),
        ("drop_supply", ("axis1", -1e5), "pressure = -100000 is out of range; give a number from 0 to 1e+09"),
        ("offset", ("position", float("nan")), "amount = nan is out of range; give a number from -1e+15 to 1e+15"),
        ("noise", ("position", -1.0), "rms = -1 is out of range; give a number from 0 to 1e+15"),
        ("slow", ("position", 0.0), "time_constant = 0 is out of range; give a number from 1e-06 to 1e+06"),
        ("break_wire", ("position", "zero"), 'reads = "zero" is unknown; give one of "nothing", "low", "high"'),
        ("lose", ("position", 1.5), "share = 1.5 is out of range; give a number from 0 to 1"),
        ("delay", ("position", -1.0), "time = -1 is out of range; give a number from 0 to 1e+09"),
        ("corrupt", ("position", 1.5), "share = 1.5 is out of range; give a number from 0 to 1"),
        ("truncate", ("position", 9), "length = 9 is out of range; give an integer from 0 to 8"),
        ("babble", ("position", 0), "frames_per_tick = 0 is out of range; give an integer from 1 to 1000"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(faults, verb, arguments, message):
    with pytest.raises(ConfigError) as caught:
        getattr(faults, verb)(*arguments)
    assert str(caught.value) == f"faults: {message}"


@pytest.mark.parametrize(
    ("which", "message"),
    [
        ({"direction": "up"}, 'direction = "up" is unknown; give one of "both", "sent", "received"'),
        ({"can_id": 1 << 29}, "can_id = 536870912 is out of range; give an integer from 0 to 536870911"),
    ],
)  # fmt: skip
def test_frames_that_cannot_be_are_refused(faults, which, message):
    with pytest.raises(ConfigError) as caught:
        faults.lose("valve", **which)
    assert str(caught.value) == f"faults: {message}"


@pytest.mark.parametrize(
    ("verb", "arguments", "keyword"),
    [
        ("freeze", ("position",), "att"),
        ("silence", ("valve",), "can_id"),
        ("lose", ("valve",), "id"),
    ],
)
def test_a_keyword_that_is_none_is_refused(faults, verb, arguments, keyword):
    """As Python does it itself, which looks at the keywords of a signature only."""
    message = rf"^{verb}\(\) got an unexpected keyword argument '{keyword}'$"
    with pytest.raises(TypeError, match=message):
        getattr(faults, verb)(*arguments, **{keyword: 1})


def test_no_time_is_refused_but_for_a_reset(faults):
    with pytest.raises(ConfigError) as caught:
        faults.freeze("position", duration=0.0)
    right = "leave it out, or give a time above 0"
    assert str(caught.value) == f"faults: freeze position: duration = 0 is no time; {right}"
    for fault in (faults.reset("valve"), faults.reset("valve", duration=0.0)):
        assert fault.duration == 0
        fault.clear()


def test_a_verb_takes_its_values_by_place_and_by_name(faults):
    """The target by the name that the verb has for it, too, as Python functions do."""
    for fault in (
        faults.lose("valve", 0.25, at=1.0),
        faults.lose(node="valve", share=0.25, at=1.0),
        faults.begin("lose", "valve", share=0.25, at=1.0),
    ):
        assert (fault.kind, fault.target, fault.begins) == ("lose", "valve", 10**9)
        fault.clear()
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'target'"):
        faults.lose()
    with pytest.raises(AttributeError, match="no fault is called loose; there are freeze, offset"):
        faults.loose("valve")


@pytest.mark.parametrize(
    ("verb", "defect"),
    [("drop_load", "load_loss"), ("wear_pump", "pump_loss"), ("lose_gas", "gas_loss")],
)
def test_without_a_share_all_is_lost_and_half_of_it_in_half_its_time(verb, defect):
    """As docs/faults.md has it: share=1.0."""
    bench = build_bench(load_config(tables={"plant": {"axis1": {"load_n": 10, "supply": "unit"}}}))
    bench.start(0)
    faults = bench.part(Faults)
    getattr(faults, verb)("axis1", growth=0.02)
    for tick in range(1, 11):
        bench.tick([], tick * 1_000_000)
    (share,) = faults.points.of(PLANTS)["axis1"].amounts[defect].values()
    assert share == pytest.approx(0.5, abs=0.05)  # a tick is a twentieth


def test_the_state_has_times_in_seconds():
    """Bench time is counted in nanoseconds."""
    faults = Faults(build_bench(load_config()).part(Faults).points)
    faults.freeze("position", at=2.0, duration=0.5)
    faults.advance(2_000_000_000)
    (state,) = faults.state(2_000_000_000)["faults"]
    assert (state["begins"], state["ends"]) == pytest.approx((2.0, 2.5))


def test_type_checkers_know_the_verbs():
    """`python tests/support/fault_verbs.py` writes the file anew."""
    assert fault_verbs.FILE.read_text(encoding="utf-8") == fault_verbs.signatures()


def test_what_was_refused_left_nothing(faults):
    assert faults.active == ()
    with pytest.raises(ConfigError):
        faults.freeze("valve")
    assert faults.due > 10**18


def test_a_bench_without_points_has_no_faults():
    with pytest.raises(ConfigError, match='there is no sensor "x"; this bench has none'):
        Faults().freeze("x")


def test_a_time_that_has_passed_is_refused():
    with VirtualBench() as bench:
        bench.run(0.01)
        bench.faults.freeze("position", at=bench.now())
        with pytest.raises(ConfigError, match=r"at = 0.009 s has passed, for it is 0.01 s"):
            bench.faults.freeze("position", at=0.009)
        with pytest.raises(ConfigError, match=r"at = 0.009 s has passed"):
            BeginFault("freeze", "position", {"at": 0.009}).act(bench.session.controls, 10_000_000)


# What faults make of a measured value and of its rate.


TICK = 1e-3


def test_a_frozen_sensor_shows_its_first_value_and_no_speed():
    stage = Frozen()
    assert [stage.value(value) for value in (3.0, 4.0, math.nan)] == [3.0, 3.0, 3.0]
    assert stage.rate(5.0) == 0.0


def test_an_offset_is_added_and_leaves_the_rate():
    stage = Shifted(2.0, 0.0, TICK)
    assert [stage.value(value) for value in (1.0, 5.0)] == [3.0, 7.0]
    assert stage.rate(0.5) == 0.5


def test_a_drift_grows_from_zero_and_is_part_of_the_rate():
    stage = Shifted(0.0, 100.0, TICK)  # 0.1 a tick
    assert [stage.value(1.0) for _ in range(3)] == pytest.approx([1.0, 1.1, 1.2])
    assert stage.rate(0.5) == 100.5


def test_noise_has_its_rms():
    stage = Noisy(2.0, normal_numbers(random_stream(1, "sensor")))
    values = [stage.value(10.0) for _ in range(5000)]
    # 5 standard deviations of an RMS from 5000 samples: 5 / sqrt(10000).
    assert np.std(values) == pytest.approx(2.0, rel=0.05)
    assert np.mean(values) == pytest.approx(10.0, abs=5 * 2.0 / math.sqrt(5000))
    assert stage.rate(0.5) == 0.5


@pytest.mark.parametrize(
    ("reading", "value"), [(BrokenReading.LOW, -math.inf), (BrokenReading.HIGH, math.inf)]
)
def test_a_broken_wire_reads_beyond_every_range(reading, value):
    stage = Broken(reading)
    assert stage.value(1.0) == value
    assert math.isnan(stage.rate(1.0))


def test_a_broken_wire_may_read_nothing():
    assert math.isnan(Broken(BrokenReading.NOTHING).value(1.0))


def test_a_slow_sensor_begins_settled_and_lags_by_its_time_constant():
    stage = Slowed(0.01, TICK)
    assert stage.value(5.0) == 5.0
    for _ in range(1000):
        last = stage.value(5.0)
    assert last == 5.0
    # A ramp of 1 a second is shown a time constant late once it has settled.
    for tick in range(1, 1000):
        shown = stage.value(5.0 + tick * TICK)
    assert 5.0 + 999 * TICK - shown == pytest.approx(0.01)
    assert stage.rate(1.0) == 1.0  # its own, settled at its first value


def test_a_lag_lets_through_what_is_no_number_and_goes_on():
    lag = Lag(0.01, TICK)
    assert lag.follow(1.0) == 1.0
    assert math.isnan(lag.follow(math.nan))
    assert lag.follow(math.inf) == math.inf
    assert lag.follow(1.0) == 1.0


def test_a_lag_may_begin_elsewhere():
    lag = Lag(1.0, TICK, start=0.0)
    # The input goes from 0 to 1 within the tick: T / (2 τ) of it is through.
    assert lag.follow(1.0) == pytest.approx(0.0005, rel=1e-3)
    assert Lag(1.0, TICK, start=2.0).follow(2.0) == 2.0
