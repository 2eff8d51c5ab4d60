"""What an expectation may say, and what is said of one that is wrong."""

import math

import numpy as np
import pytest

from hil_bench.abilities.scenario.dimensions import UNITS, find_unit, unit_of_name
from hil_bench.abilities.scenario.judgement import (
    RequirementOutcome,
    judge,
    show_gap,
    show_number,
    show_reading,
)
from hil_bench.abilities.scenario.monitor import Monitor, window_ticks
from hil_bench.abilities.scenario.nodes import (
    All,
    Always,
    Comparison,
    Eventually,
    Implies,
    Not,
    Vocabulary,
    Window,
)
from hil_bench.abilities.scenario.parse import parse_expectation
from hil_bench.abilities.scenario.reach import CERTAIN, reach, survives_a_cut
from hil_bench.abilities.scenario.results import reason_of
from hil_bench.abilities.scenario.syntax import ExpectationError
from hil_bench.units import BAR, ONE, read_unit

TICK = 1_000_000
KNOWN = Vocabulary(
    {"axis1.P_A": "Pa", "axis1.position": "m", "target": "m", "io.count": "lux", "flag": "-"},
    {"valve.state": {"HOLD": 1, "ENABLED": 2}},
    ("valve", "pressure_a"),
    has_frames=True,
    parameters={"target_mm": 0.1, "settle_ms": 0.2},
)


def parse(text):
    return parse_expectation(text, KNOWN)


def run(text, **columns):
    ticks = len(next(iter(columns.values())))
    names = {"P_A": "axis1.P_A", "position": "axis1.position", "state": "valve.state"}
    given = {names.get(name, name): np.array(column, float) for name, column in columns.items()}
    return judge(parse(text), given, ticks=ticks, tick_ns=TICK)


def test_units_become_si():
    found = parse("axis1.P_A < 250 bar")
    assert isinstance(found, Comparison)
    assert found.right.value == 250e5  # 1 bar = 1e5 Pa
    assert found.scale == 250e5
    assert parse("axis1.P_A < 25 MPa").right.value == 25e6
    assert parse("axis1.position < target_mm").right.value == 0.1
    assert parse("rate(axis1.position) < 20 mm/s").right.value == pytest.approx(0.02)


def test_the_scale_is_the_tolerance_that_the_author_wrote():
    """The table in docs/expectations.md; target_mm is 100 mm, and 10 mm stands for nothing."""
    expected = {
        "axis1.position < target_mm + 0.3 mm": 0.3e-3,
        "axis1.position > 0.3 mm + target_mm - 2 mm": 0.3e-3,
        "axis1.position < target_mm": 0.1,
        "axis1.position < -(target_mm + 0.3 mm)": 0.3e-3,
        "axis1.position < target_mm + 0 mm": 0.1,
        "axis1.position < 1.05 * target_mm": 0.105,
        "axis1.position < abs(target_mm + 0.3 mm)": 0.1003,
        "axis1.position - 5 mm < target_mm": 0.1,
        "axis1.position < target + 0.3 mm": 0.3e-3,
        "axis1.position - 0.1 mm < target + 0.3 mm": 0.1e-3,
        "axis1.position < -(target + 0.3 mm)": 0.3e-3,
        "abs(axis1.position - 5 mm) < target": 0.01,
        "previous(axis1.position - 5 mm) < target": 0.01,
        "2 * (axis1.position - 5 mm) < target": 0.01,
        "abs(axis1.position - target) < 0.5 mm": 0.5e-3,
        "axis1.position < target": 0.01,
        "axis1.position < 0": 0.01,
    }
    assert {text: parse(text).scale for text in expected} == pytest.approx(expected, rel=1e-12)


def test_each_unit_means_the_same_in_an_expectation_and_above_a_column():
    for symbol in UNITS.keys() - {"-"}:
        column = read_unit(symbol)
        found = parse_expectation(f"always x < 2 {symbol}", Vocabulary({"x": column.symbol}))
        assert found.operand.right.value == 2.0 * column.factor, symbol


@pytest.mark.parametrize(
    ("text", "si"),
    [
        # NIST SP 811 (2008), appendix B.8, in its digits.
        ("1 inch", 2.54e-2),
        ("1 ft/min", 5.08e-3),
        ("1 in3", 1.638706e-5),
        ("1 gal", 3.785412e-3),
        ("1 gpm", 6.309020e-5),
        ("1 psi", 6.894757e3),
        ("1 ksi", 6.894757e6),
        ("1 atm", 1.01325e5),
        ("1 kgf/cm2", 9.80665e4),
        ("1 kp", 9.80665),
        ("1 lbf", 4.448222),
        ("1 lbf/in", 1.751268e2),
        ("1 lbf ft", 1.355818),
        ("1 lbf in", 1.129848e-1),
        ("1 lb", 4.535924e-1),
        ("1 rpm", 1.047198e-1),
        ("1 GPa", 1e9),
        ("1 cm", 1e-2),
        ("1 kNm", 1e3),
    ],
)
def test_units_have_the_factors_of_their_definitions(text, si):
    unit = text.removeprefix("1 ")
    found = parse_expectation(f"x < {text}", Vocabulary({"x": read_unit(unit).symbol}))
    assert found.right.value == pytest.approx(si, rel=5e-7)  # half of the last digit


def test_a_parameter_has_the_unit_that_its_name_ends_in():
    expected = {
        "limit_gpa": 1e9,
        "way_cm": 1e-2,
        "way_inch": 0.0254,
        "turn_deg_s": math.pi / 180.0,
        "drop_mpa_s": 1e6,
        "pressure_in": 1.0,
        "gain_kp": 1.0,
    }
    assert {name: unit_of_name(name).unit.factor for name in expected} == expected


def test_arithmetic_keeps_the_units():
    assert parse("axis1.P_A / 2 < 2 * 100 bar").right.value == 200e5
    assert parse("rate(axis1.P_A) < 3 bar / 100 ms").right.value == pytest.approx(30e5)


def test_constants_are_calculated():
    expected = {"3 bar - 1 bar": 2e5, "1 bar * 3": 3e5, "3 bar / 2": 1.5e5}
    assert {
        limit: parse(f"axis1.P_A < {limit}").right.value for limit in expected
    } == pytest.approx(expected)


@pytest.mark.parametrize(
    "text",
    [
        "rate(rate(axis1.position)) > 1 m/s² + 1 mm/s²",
        "rate(axis1.position) > 1 m/s² * 1 s",
        "rate(axis1.P_A) > 1 bar/s + 1 Pa/s",
        "axis1.P_A * 1 cm² > 1 kN",
        "axis1.position * 1 N/mm > 1 N",
        "axis1.position * 1 cm² > 1 l + 1 cm³",
        "axis1.position * 1 cm² / 1 s > 1 l/min",
        "axis1.position * 1 Hz > 1 m/s",
        "axis1.P_A * 1 m²  > 1 kg * 1 m/s²",
    ],
)
def test_units_of_physics_fit_together(text):
    """F = p A, F = m a, W = F s, Q = V / t: what is the same kind of unit is compared."""
    assert parse(text).relation == ">"


def test_zero_needs_no_unit():
    assert parse("axis1.P_A > 0").right.value == 0.0


def test_a_number_is_in_the_unit_of_a_signal_that_nobody_knows():
    assert parse("io.count < 3").right.value == 3.0


def test_a_word_takes_in_all_that_follows():
    found = parse("always axis1.P_A > 0 and flag > 0 implies target > 0")
    assert isinstance(found, Always)
    assert isinstance(found.operand, Implies)
    assert isinstance(found.operand.trigger, All)


def test_not_binds_a_condition_alone():
    found = parse("not flag > 0 and target > 0")
    assert isinstance(found, All)
    assert isinstance(found.operands[0], Not)


def test_for_binds_the_condition_before_it():
    found = parse("flag > 0 and target > 0 for 200 ms")
    assert isinstance(found, All)
    assert found.operands[1].window == Window(0, 200_000_000)


def test_within_has_a_parameter_as_time():
    found = parse("within settle_ms flag > 0")
    assert isinstance(found, Eventually)
    assert found.window == Window(0, 200_000_000)


def test_a_name_of_the_language_is_quoted():
    known = Vocabulary({"for": "-", "a-b": "-"})
    assert parse_expectation("'for' > 1 and 'a-b' > 1", known)


def test_reach_adds_up():
    text = "whenever rises(target) then within 1.5 s (flag > 0 for 200 ms)"
    assert reach(parse(text)) == 1_700_000_000


A, B = "axis1.P_A > 0.5 bar", "flag > 0.5"
LASTING = [
    f"always {A} and {B}",
    f"always after 3 ms {A} or historically {B}",
    f"eventually from 0 s to 5 ms {A}",
    "eventually from 0 s to 5 ms settled(axis1.P_A - 1 bar, 0.4 bar)",
    f"({A}) until within 5 ms {B}",
    f"not ({A}) or always not ({B})",
]
FLEETING = [  # an end that comes earlier fails them, leaves them open, or takes the trigger away
    f"eventually {A}",
    f"not always {A}",
    f"({A}) until {B}",
    f"always eventually {A}",
    f"always within 2 ms {A}",
    f"whenever {A} then {B}",
]


def passes(condition, columns, ticks):
    cut = {name: column[:ticks] for name, column in columns.items()}
    return judge(condition, cut, ticks=ticks, tick_ns=TICK).outcome is RequirementOutcome.PASSED


@pytest.mark.parametrize("text", [*LASTING, *FLEETING])
def test_what_survives_a_cut_passes_every_beginning_of_a_passed_run(text):
    condition, generator = parse(text), np.random.default_rng(0)
    fewest = reach(condition) // TICK + 1
    broken = seen = 0
    for _ in range(60):
        shares = generator.choice([0.1, 0.5, 0.98, 1.0], (2, 1))
        drawn = np.where(generator.random((2, 12)) < shares, 1.0, 0.0)
        columns = {"axis1.P_A": drawn[0] * 1e5, "flag": drawn[1]}
        if passes(condition, columns, 12):
            seen += 1
            broken += not all(passes(condition, columns, n) for n in range(fewest, 12))
    assert seen > 5
    assert survives_a_cut(condition) == (broken == 0) == (text in LASTING)


@pytest.mark.parametrize(
    ("text", "line", "column", "what"),
    [
        ("always axis1.P_A < 250 mm", 1, 20, "in bar and one in mm makes no sense"),
        ("axis1.P_A < 250", 1, 13, "give the number its unit"),
        ("axis1.P_A + axis1.position > 0", 1, 13, "in bar and one in mm makes no sense"),
        (
            "always\n  axis1.P_a < 1 bar",
            2,
            3,
            '"axis1.P_a" is no signal here; the nearest is axis1.P_A',
        ),
        ("axis1.P_A < 3 bars", 1, 13, '"bars" is no unit of the language; the nearest is bar'),
        ("axis1.P_A < 1,5 bar", 1, 14, "write decimals with a point"),
        ("flag = 1", 1, 6, "write == to compare"),
        ("always axis1.P_A", 1, 8, "needs a condition"),
        ("abs(flag > 1) > 2", 1, 5, "needs a value, and this is a condition"),
        ('abs("HOLD") > 2', 1, 5, "needs a value, and this is a text"),
        ("abs(valve.state) > 2", 1, 5, "needs a value, and this is the state valve.state"),
        ("within 5 bar flag > 0", 1, 8, "is a value in bar, not a time"),
        ("within target flag > 0", 1, 8, "is a signal, not a time"),
        ("always from 2 s to 1 s flag > 0", 1, 8, "ends before it begins"),
        ("eventually within 2 s flag > 0", 1, 1, "write within T A alone"),
        ("valve.state == 2", 1, 1, 'valve.state == "HOLD"'),
        ('valve.state == "HOLDD"', 1, 16, 'valve.state is never "HOLDD"; the nearest is "HOLD"'),
        ("valve.state == HOLD", 1, 16, 'HOLD is a state; write "HOLD" with its quotes'),
        ('valve.state < "HOLD"', 1, 1, "give == or !="),
        ("rises(valve.state)", 1, 1, 'rises(valve.state == "...")'),
        ("emcy(valv)", 1, 6, '"valv" is no node; the nearest is valve'),
        ("not emcy(valve, 8130)", 1, 17, "8130 is decimal here; write 0x8130, or 0x1FC2 for the"),
        ("frame(181)", 1, 7, "181 is decimal here; write 0x181, or 0xB5 for the same number"),
        ("emcy(5)", 1, 1, "emcy takes the name of a node"),
        ("emcy(5, 0x8110)", 1, 1, "emcy takes the name of a node"),
        ("emcy(valve, 0x8110, 1)", 1, 1, "emcy takes the name of a node"),
        ("frame(1.5)", 1, 7, "is no number from 0 to"),
        ("settled(flag)", 1, 1, "settled(deviation, band"),
        ("settled(flag, 1, 5 bar)", 1, 18, "is no time"),
        ("settled(flag, 1, axis1.P_A)", 1, 18, "is no time"),
        ("settle(flag, 1)", 1, 1, "the nearest is settled"),
        ("target_mm < 3 mm", 1, 1, "compares no signal"),
        ("always (axis1.P_A) <= axis1.P_A", 1, 9, "compares a value with itself"),
        ("abs(target - 1 mm) == abs(target - 1 mm)", 1, 1, "compares a value with itself"),
        ("-5 mm < target < target", 1, 9, "compares a value with itself"),
        ("whenever rises(target_mm) then flag > 0", 1, 10, "holds no signal"),
        ("flag / 0 > 1", 1, 8, "divides by 0"),
        ("(flag > 0", 1, 10, 'ends too early; ")" is right'),
        ("always", 1, 7, "ends too early; a signal, a number or a condition is right"),
        (
            'valve.state == "HOLD" flag',
            1,
            23,
            "an operator such as <, and, or, until is right, or the end",
        ),
        ("flag > 0 ) 1", 1, 10, "does not fit here"),
        ("flag > 1e999", 1, 8, "too large"),
        ("", 1, 1, "is empty"),
        ("x" * 10_000, 1, 1, "has 10000 characters; give at most 4000"),
        ("(" * 1500 + "flag > 0" + ")" * 1500, 1, 61, "nested more than 60 levels deep"),
        ("not " * 900 + "flag > 0", 1, 241, "nested more than 60 levels deep"),
        ("flag > 0 \x1b[2J", 1, 10, "does not fit here"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(text, line, column, what):
    with pytest.raises(ExpectationError) as error:
        parse(text)
    assert error.value.position == (line, column)
    assert what in error.value.what
    assert str(error.value).startswith(f"line {line}, column {column}: ")
    assert "\n" not in str(error.value)
    assert "\x1b" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("axis1.P_A < 250 bar", "asks about the first tick alone; always asks about each"),
        ("always axis1.P_A < 250 bar", ""),
        ("always axis1.position < 250 mm", "axis1.position never changed"),
        ("always axis1.position < 250 mm and axis1.P_A < 250 bar", ""),
        ("always not frame(0x181)", ""),
        # A limit that no machine reaches: no stroke is beyond 100 m, no pressure above 3000 bar.
        ("always axis1.position < 100 m", "axis1.position never changed"),
        ("always abs(axis1.position) < 100.1 m", CERTAIN),
        ("always axis1.P_A < 1e5 bar and axis1.P_A > -1e5 bar", CERTAIN),
        ("always not axis1.P_A > 3001 bar", CERTAIN),
        ("whenever axis1.P_A > 1 bar then 2 * axis1.P_A < 6001 bar", CERTAIN),
        # Sums in which the signal falls out, a magnitude, and a condition beside its contrary.
        ("always axis1.P_A < axis1.P_A + 1 bar", CERTAIN),
        ("always axis1.P_A + axis1.P_A - 2 bar <= 2 * axis1.P_A - 2 bar", CERTAIN),
        (
            "always previous(axis1.P_A) < previous(axis1.P_A) - (axis1.P_A - axis1.P_A - 1 bar)",
            CERTAIN,
        ),
        ("always rate(axis1.P_A) >= -abs(1e9 bar/s)", ""),
        ("always abs(axis1.P_A) >= 0 bar", CERTAIN),
        ("always abs(axis1.P_A) > 0 bar", ""),
        ("always (axis1.P_A < 1 bar or axis1.P_A >= 1 bar)", CERTAIN),
        ("always (axis1.P_A < 1 bar or axis1.P_A > 1 bar or not flag < 1)", ""),
        ("always (axis1.P_A < 1 bar or not axis1.P_A < 1 bar)", CERTAIN),
        ("whenever axis1.P_A > 1 bar then axis1.P_A > 1 bar", CERTAIN),
    ],
)
def test_a_pass_that_says_little_says_so(text, reason):
    columns = {
        "P_A": [2e5, 1e6, 3e5],
        "position": [0.1] * 3,
        "flag": [1, 1, 1],
        "frame(0x181)": [0, 0, 0],
    }
    found = run(text, **columns)
    assert (found.outcome, found.reason) == ("passed", reason)


def test_a_long_sum_of_conditions_is_no_nesting():
    parse(" and ".join(["flag > 0"] * 300))


def test_a_failure_says_when_how_long_and_how_bad():
    found = run("always axis1.P_A < 250 bar", P_A=[1e5, 260e5, 275e5, 1e5, 251e5])
    assert found.outcome is RequirementOutcome.FAILED
    assert (found.first, found.duration) == (0.001, 0.002)
    assert found.deciding.time == 0.002
    assert found.deciding.reading == "275 bar"
    assert found.deciding.margin == "-25 bar"
    assert found.margin == pytest.approx(-0.1)  # 25 of 250 bar


def test_a_pass_says_where_it_was_closest():
    found = run("always axis1.P_A < 250 bar", P_A=[1e5, 200e5, 245e5, 1e5])
    assert found.outcome is RequirementOutcome.PASSED
    assert found.margin == pytest.approx(0.02)  # 5 of 250 bar
    assert (found.deciding.time, found.deciding.margin) == (0.002, "5 bar")


def test_what_was_never_triggered_is_no_pass():
    text = "whenever flag > 0 then axis1.P_A < 250 bar"
    found = run(text, flag=[0, 0, 0], P_A=[1, 1, 1])
    assert (found.outcome, found.triggered) == (RequirementOutcome.NOT_EXERCISED, 0)
    found = run(text, flag=[1, 0, 1], P_A=[1, 1, 1])
    assert (found.outcome, found.triggered) == (RequirementOutcome.PASSED, 2)


@pytest.mark.parametrize(
    ("text", "flag", "remark"),
    [
        ("eventually flag > 0", [1, 0, 0, 0], "from the start"),
        ("eventually flag > 0", [0, 1, 1, 1], ""),
        ("within 2 ms flag > 0", [1, 1, 0, 0], "from the start"),
        ("eventually from 1 ms to 2 ms flag > 0", [0, 1, 0, 0], "from the start"),
        ("eventually from 1 ms to 2 ms flag > 0", [1, 0, 1, 1], ""),
        ("axis1.P_A < 1 bar until flag > 0", [1, 0, 0, 0], "from the start"),
        ("axis1.P_A < 1 bar until flag > 0", [0, 0, 1, 0], ""),
        ("whenever axis1.P_A > 0 then within 1 ms flag > 0", [0, 1, 1, 0], "at each trigger"),
        ("whenever axis1.P_A > 0 then within 1 ms flag > 0", [0, 0, 1, 0], ""),
        ("always axis1.P_A < 1 bar", [1, 1, 1, 1], ""),
    ],
)
def test_a_pass_says_where_nothing_was_waited_for(text, flag, remark):
    """P_A is above 0 at the ticks 1 and 2: by docs/expectations.md the goal is looked at there."""
    found = run(text, flag=flag, P_A=[0, 1, 1, 0])
    assert found.outcome is RequirementOutcome.PASSED
    assert bool(found.reason) == bool(remark)
    assert remark in found.reason


def test_a_trigger_outside_the_window_does_not_count():
    text = "always from 1 ms to 2 ms (flag > 0 implies axis1.P_A > 0)"
    found = run(text, flag=[1, 0, 0, 1], P_A=[1, 1, 1, 1])
    assert found.outcome is RequirementOutcome.NOT_EXERCISED


def test_a_run_that_ends_too_early_is_inconclusive():
    text = "whenever rises(flag) then within 3 ms axis1.P_A > 1 bar"
    late = run(text, flag=[0, 0, 1, 1], P_A=[0, 0, 0, 0])
    assert late.outcome is RequirementOutcome.INCONCLUSIVE
    assert "the run ends" in late.reason
    met = run(text, flag=[0, 0, 1, 1], P_A=[0, 0, 0, 2e5])
    assert met.outcome is RequirementOutcome.PASSED


def test_a_missing_value_is_never_true():
    nan = float("nan")
    assert run("always flag > 0", flag=[1, nan, 1]).outcome is RequirementOutcome.INCONCLUSIVE
    assert run("always not flag > 0", flag=[0, nan, 0]).outcome is RequirementOutcome.INCONCLUSIVE
    assert run("always flag > 0", flag=[1, nan, 0]).outcome is RequirementOutcome.FAILED
    assert run("eventually flag > 0", flag=[nan, 1]).outcome is RequirementOutcome.PASSED
    missing = run("always flag > 0 or target > 0", flag=[nan], target=[1])
    assert missing.outcome is RequirementOutcome.PASSED


@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_a_quotient_by_0_is_unknown(zero):
    for relation in ("<", ">"):
        text = f"always axis1.position / target {relation} 5"
        assert run(text, position=[1], target=[zero]).outcome == "inconclusive"


def test_a_margin_of_nothing_is_decided_by_the_relation():
    assert run("always flag <= 1", flag=[1]).outcome is RequirementOutcome.PASSED
    assert run("always flag < 1", flag=[1]).outcome is RequirementOutcome.FAILED
    assert run("always flag == 1", flag=[1]).outcome is RequirementOutcome.PASSED


@pytest.mark.parametrize("text", ["always flag > 5", "always flag < 5", "always rises(flag)"])
@pytest.mark.parametrize("reading", [np.inf, -np.inf])
def test_an_infinite_reading_is_unknown(text, reading):
    found = run(text, flag=[reading, reading])
    assert found.outcome is RequirementOutcome.INCONCLUSIVE
    assert found.coverage.unknown == 2 * TICK / 1e9


def test_an_infinite_code_is_no_state():
    found = run('always not valve.state == "HOLD"', state=[np.inf])
    assert found.outcome is RequirementOutcome.INCONCLUSIVE


TURNING = Vocabulary({"n": "rad/s", "f": "Hz", "angle": "rad", "share": "-", "torque": "N m"})


@pytest.mark.parametrize(
    "text",
    [
        "n < 10 Hz",
        "f < 10 rpm",
        "f < 1 rad/s",
        "angle < 50 %",
        "angle < 0.5",
        "share < 3 deg",
        "rate(angle) < 1 Hz",
        "n - f > 0",
        "angle > share",
        "torque < 1 N",
    ],
)
def test_frequencies_angles_and_ratios_are_not_compared(text):
    with pytest.raises(ExpectationError, match="makes no sense"):
        parse_expectation(text, TURNING)


def test_each_kind_of_unit_has_its_own_numbers():
    expected = {
        "n < 60 rpm": math.tau,
        "rate(angle) < 60 rpm": math.tau,
        "angle < 1 rev": math.tau,
        "f < 10 Hz": 10.0,
        "share < 50 %": 0.5,
        "torque < 2 N m": 2.0,
    }
    assert {
        text: parse_expectation(text, TURNING).right.value for text in expected
    } == pytest.approx(expected)


def test_before_the_run_all_was_as_at_its_first_tick():
    assert run("not rises(flag) and not changes(valve.state)", flag=[5], state=[2]).margin is None
    assert run("rate(flag) == 0 Hz", flag=[5, 7]).outcome is RequirementOutcome.PASSED


def test_a_state_is_compared_with_its_text():
    text = 'whenever changes(valve.state) then valve.state == "HOLD"'
    assert run(text, state=[2, 2, 1, 1]).outcome is RequirementOutcome.PASSED
    failed = run(text, state=[1, 1, 2, 2])
    assert failed.outcome is RequirementOutcome.FAILED
    assert failed.deciding.condition == 'valve.state == "HOLD"'
    assert failed.margin is None  # a state has no size


def test_bounds_between_ticks_take_the_ticks_inside():
    # Ticks at 0, 1, 2, 3 ms: 0.5 to 2.5 ms holds those at 1 and 2 ms.
    assert run("always from 500 us to 2500 us flag > 0", flag=[0, 1, 1, 0]).outcome == "passed"
    assert run("always from 500 us to 3000 us flag > 0", flag=[0, 1, 1, 0]).outcome == "failed"


@pytest.mark.parametrize(
    "window", ["from 200 us to 800 us", "from 800 us to 1500 us", "within 999 us"]
)
def test_a_window_shorter_than_a_tick_is_refused(window):
    # Whether the flag fell within it, no row says: neither a pass nor a failure would be seen.
    with pytest.raises(ExpectationError, match="is shorter than a tick of 1 ms"):
        run(f"always {window} flag > 0", flag=[1, 1])
    run("always from 0 us to 1000 us flag > 0", flag=[1, 1])
    run("always from 1 ms to 1 ms flag > 0", flag=[1, 1])  # an instant is seen


def test_a_window_of_a_tick_between_ticks_is_none_too_short():
    # 1.5 and 2.5 ticks of 1/512 s are 2929687.5 and 4882812.5 ns, each rounded to an even one.
    window = Window(round(2929687.5), round(4882812.5))
    assert window.end - window.start == 1_953_124
    node = parse_expectation("always flag > 0", Vocabulary({"flag": "1"}))
    assert window_ticks(node, window, 1_953_125) == (2, 2)


def test_the_margin_of_equal_sides_is_shown_as_zero():
    found = run("always flag < 5", flag=[1, 5])
    assert (found.outcome, found.deciding.margin) == ("failed", "-0")


def test_settled_is_for_the_rest_of_the_run_or_a_time():
    position = [0.0, 0.1001, 0.0999, 0.1, 0.2]
    target = [0.1] * 5
    text = "eventually settled(axis1.position - target, 0.5 mm{})"
    assert run(text.format(""), position=position, target=target).outcome == "failed"
    assert run(text.format(", 2 ms"), position=position, target=target).outcome == "passed"


@pytest.mark.parametrize(
    ("text", "node_at"),
    [
        ("flag > 0 until within 3 ms target > 0", ("target > 0 mm", 0.002)),
        ("flag > 4 until from 5 ms to 8 ms target > 0", ("flag > 4", 0.0)),  # behind the run
        ("eventually flag > 9", ("flag > 9", 0.001)),
        ("not eventually (flag > 4 and target > -1 mm)", ("not flag > 4", 0.001)),
        ("always (flag < 9 for the last 1 ms)", ("flag < 9", 0.001)),
        ("always flag < 9 and target < 5 m", ("flag < 9", 0.001)),
        ("previous(flag) < 9", ("previous(flag) < 9", 0.0)),
        # What asks for a time behind the run is not known, so it decides nothing.
        ("(always flag < 5) and eventually after 7 ms falls(flag)", ("flag < 5", 0.001)),
        ("(always flag < 5) and always after 7 ms falls(flag)", ("flag < 5", 0.001)),
        ("(always flag < 5) and eventually from 1 ms to 7 ms flag < -9", ("flag < 5", 0.001)),
    ],
)
def test_the_comparison_that_decides_is_named(text, node_at):
    found = run(text, flag=[1, 5, 2, 1], target=[0, 0, 1e-3, 0])
    assert (found.deciding.condition, found.deciding.time) == node_at


@pytest.mark.parametrize(
    ("text", "columns", "words"),
    [
        (
            "always not axis1.P_A > 250 bar",
            {"P_A": [1e5, 245e5, 2e5]},
            "closest at 0.001 s: axis1.P_A was 245 bar, 5 bar below 250 bar (+0.02 of the",
        ),
        (
            "always not axis1.P_A > 250 bar",
            {"P_A": [1e5, 255e5, 2e5]},
            ("first violated at 0.001 s, for 0.001 s in all; worst at 0.001 s: axis1.P_A was "
            "255 bar, 5 bar above 250 bar (-0.02 of the tolerance)"),
        ),
        (
            "always 0.3 mm > axis1.position - target",
            {"position": [0.08, 0.0801], "target": [0.08, 0.08]},
            "closest at 0.001 s: axis1.position - target was 0.1 mm, 0.2 mm below 0.3 mm (+0.67",
        ),
        (
            "always axis1.position < target + 0.3 mm",
            {"position": [0.08, 0.0801], "target": [0.08, 0.08]},
            ("closest at 0.001 s: axis1.position was 80.1 mm, 0.2 mm below target + 0.3 mm "
            "(80.3 mm) (+0.67 of the tolerance)"),
        ),
        ("always axis1.P_A <= 250 bar", {"P_A": [250e5]}, "axis1.P_A was exactly 250 bar; seen"),
        (
            "always axis1.P_A < 250 bar",
            {"P_A": [249.9999e5]},
            "axis1.P_A was 249.9999 bar, 0.0001 bar below 250 bar",
        ),
        ('always state == "HOLD"', {"state": [2]}, ("first violated at 0 s; "
         "at 0 s: valve.state was not HOLD; seen")),
        ('always not state == "HOLD"', {"state": [1]}, "at 0 s: valve.state was HOLD; seen"),
        ("eventually rises(flag)", {"flag": [1, 1]}, "at 0 s: flag did not rise; seen"),
        ("eventually rises(flag)", {"flag": [1, 2]}, "at 0.001 s: flag rose; seen"),
        ("eventually falls(flag)", {"flag": [1, 1]}, "at 0 s: flag did not fall; seen"),
        ("eventually falls(flag)", {"flag": [2, 1]}, "at 0.001 s: flag fell; seen"),
        ("eventually changes(flag)", {"flag": [1, 1]}, "at 0 s: flag did not change; seen"),
        ("eventually changes(flag)", {"flag": [2, 1]}, "at 0.001 s: flag changed; seen"),
        ("always not frame(0x181)", {"frame(0x181)": [0, 1]}, "0.001 s: frame(0x181) was seen;"),
        ("always not frame(0x181)", {"frame(0x181)": [0, 0]}, "frame(0x181) was not seen;"),
        ("eventually rises(flag > 1)", {"flag": [2, 2]}, "at 0 s: rises(...) was not seen;"),
    ],
)  # fmt: skip
def test_a_verdict_is_worded_as_a_fact(text, columns, words):
    found = reason_of(run(text.replace("state ==", "valve.state =="), **columns))
    assert words in found


@pytest.mark.parametrize(
    ("text", "rank"),
    [
        ("always flag < 9", "closest"),
        ("always flag < 2", "worst"),
        ("eventually flag > 2", "best"),
        ("eventually flag > 9", "closest"),
        ("not eventually flag > 9", "closest"),
        ("not always flag > 9", "best"),
        ("(always flag < 9) and always after 1 ms flag < 8", "closest"),
        ("(always flag < 9) and eventually flag > 2", ""),
        ("flag < 9", ""),
        ("flag > 9", ""),
        ("always frame(0x181)", ""),
    ],
)
def test_the_deciding_tick_is_ranked(text, rank):
    found = run(text, **{"flag": [1, 3], "frame(0x181)": [1, 1]})
    assert found.deciding.rank == rank
    assert f"{rank} at 0".lstrip() in reason_of(found)


def test_the_condition_is_what_had_to_be_true():
    (held, broken) = (run("always not flag > 2", flag=[1, flag]) for flag in (1, 3))
    assert held.deciding.condition == broken.deciding.condition == "not flag > 2"
    (held, broken) = (run("always flag < 2", flag=[1, flag]) for flag in (1, 3))
    assert held.deciding.condition == broken.deciding.condition == "flag < 2"


@pytest.mark.parametrize(
    ("text", "duration"),
    [
        ("always flag < 2", 0.003),
        ("always (flag < 2 for the last 1 ms)", 0.004),
        ("always (flag > 2 implies flag > 9)", 0.003),
        ("(always flag < 2) and always flag < 9", 0.003),
        ("whenever rises(flag) then flag > 9", 0.0),
        ("always not rises(flag > 2)", 0.0),
        ("always (flag > 2 implies (flag > 9 within the last 1 ms and flag < 9))", 0.003),
        ("whenever flag > 2 then within 1 ms flag < 0", 0.0),
        ("always (flag < 2 for 1 ms)", 0.0),
        ("always (flag < 2 until flag > 9)", 0.0),
        ("always not frame(0x181)", 0.0),
        ("eventually flag > 9", 0.0),
    ],
)
def test_instants_do_not_add_up_to_a_time(text, duration):
    """The flag is above 2 for three ticks of 1 ms; an edge, an event or a trigger has no length."""
    columns = {"flag": [1, 3, 3, 3, 1, 1], "frame(0x181)": [0, 1, 1, 0, 0, 0]}
    found = run(text, **columns)
    assert (found.outcome, found.duration) == ("failed", duration)
    assert (" in all" in reason_of(found)) == (duration > 0.0)


def test_numbers_have_the_digits_that_matter():
    expected = {
        (48.4536e5, 200e5, "bar"): "48.45 bar",
        (12345.678, 1.0, "N"): "12345.678 N",
        (12345.678, 5e4, "N"): "12346 N",
        (1.234567e-12, 1.0, "m"): "1.235e-12 m",
        (0.0, 1.0, "m"): "0 m",
        (-2.5e-3, 1.0, "mm"): "-2.5 mm",
        (2e9, 0.0, ""): "2e+09",
        (100.0, 1.0, "N"): "100 N",
    }
    assert {
        (value, apart, unit): show_reading(value, apart, find_unit(unit).unit if unit else ONE)
        for value, apart, unit in expected
    } == expected


def test_a_gap_has_four_digits_and_a_constant_six():
    assert show_gap(123_456.0, BAR) == "1.235 bar"
    assert show_number(1_234_567.0, BAR) == "12.3457 bar"


def test_nothing_to_judge_is_inconclusive():
    found = judge(parse("always flag > 0"), {"flag": np.empty(0)}, ticks=0, tick_ns=TICK)
    assert (found.outcome, found.reason) == ("inconclusive", "nothing seen")


def test_a_window_is_met_with_its_last_tick_and_not_before():
    monitor = Monitor(parse("always from 0 ms to 3 ms flag < 9"), TICK)
    for tick, flag in enumerate((1.0, 1.0, 1.0, 1.0)):
        assert not monitor.is_met, tick
        monitor.push({"flag": np.array([flag])}, 1)
    assert monitor.is_met
    monitor = Monitor(parse("always from 0 ms to 3 ms flag < 9"), TICK)
    monitor.push({"flag": np.ones(3)}, 3)
    monitor.finish()
    assert not monitor.is_met
