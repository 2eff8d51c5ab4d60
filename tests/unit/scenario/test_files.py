"""Scenario files: what they hold, what becomes of it at ticks, and what is wrong with bad ones."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.tables import from_text

from hil_bench.abilities.controllers.power import Power
from hil_bench.abilities.faults.fault import FaultConfig
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.nodes import Vocabulary
from hil_bench.abilities.scenario.records import (
    Controller,
    Expectation,
    FaultStep,
    FirmwareStep,
    NmtStep,
    NmtVerb,
    Parameter,
    Reference,
    Scenario,
    SetStep,
    SyncStep,
)
from hil_bench.abilities.scenario.resolve import (
    SetAction,
    compile_expectations,
    parameter_values,
    resolve_steps,
)
from hil_bench.abilities.scenario.usage import usage_problems
from hil_bench.abilities.scenario.writing import to_csv, to_toml, write_scenario
from hil_bench.errors import ConfigError

MS = 1_000_000
EXPECT = '[[expect]]\nid = "R1"\nthat = "always axis1.P_A < 250 bar"\n'
HEAD = 'title = "T"\nduration_s = 6.0\n'
WHOLE = (
    HEAD
    + """
bench = "bench.toml"
requirement_ids = ["R1"]

[controller]
firmware = ["control", "--target-mm", "{target_mm}"]

[parameters]
target_mm = { value = 100.0, range = [20.0, 180.0] }
sag_bar = 60.0
sag_at_ms = { value = 2000.0, range = [500.0, 5000.0] }

[[step]]
at_s = "sag_at_ms"
fault = "drop_supply"
target = "axis1"
pressure_bar = "sag_bar"
for_s = 0.5

[[step]]
at_s = 0.5
set = { "valve.spool_setpoint" = 0.4, "axis1.load" = "5 kN" }
over_s = 0.2

[[step]]
at_s = 3
nmt = "stop"
target = "valve"

[[step]]
at_s = 3.0004
sync = false

[[step]]
at_s = 4
firmware = "restart"

"""
    + EXPECT
)


def load(tmp_path, text, name="a.scenario.toml"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_scenario(path)


def refusal(tmp_path, text, name="a.scenario.toml"):
    with pytest.raises(ConfigError) as error:
        load(tmp_path, text, name)
    return str(error.value).replace(f"{tmp_path}/", "")


def test_a_file_becomes_records(tmp_path):
    found = load(tmp_path, WHOLE)
    assert found.controller == Controller(("control", "--target-mm", "{target_mm}"))
    assert found.parameters[0] == Parameter("target_mm", 100.0, (20.0, 180.0))
    assert found.steps == (
        FaultStep(
            Reference("sag_at_ms"),
            "drop_supply",
            "axis1",
            (("for_s", 0.5), ("pressure_bar", Reference("sag_bar"))),
        ),
        SetStep(0.5, "valve.spool_setpoint", 0.4, 0.2),
        SetStep(0.5, "axis1.load", 5000.0, 0.2),
        NmtStep(3.0, NmtVerb.STOP, "valve"),
        SyncStep(3.0004, is_on=False),
        FirmwareStep(4.0, Power.RESTART),
    )
    assert found.expectations == (Expectation("R1", "always axis1.P_A < 250 bar"),)


def test_steps_act_at_ticks_with_numbers(tmp_path):
    scenario = load(tmp_path, WHOLE)
    values = parameter_values(scenario, {"sag_bar": 30.0})
    assert values == {"target_mm": 0.1, "sag_bar": 30e5, "sag_at_ms": 2.0}
    actions = resolve_steps(scenario, MS, values)
    assert actions[0][:2] == (500, SetAction("valve.spool_setpoint", 0.4, 200))
    sag = FaultConfig("drop_supply", "axis1", 2.0, 0.5, {"pressure": 30e5})
    assert actions[2][:2] == (2000, sag)
    assert actions[4].tick == 3001  # 3000.4 ms lies between ticks: the later one
    assert [each.tick for each in actions] == sorted(each.tick for each in actions)


@pytest.mark.parametrize(("at", "given"), [('"late_s"', 6.5), ("6.0002", 1.0)])
def test_a_step_that_would_never_act_is_refused(tmp_path, at, given):
    """A given value lies behind the end; 6.0002 s behind the last tick of 6.0004 s."""
    head = HEAD.replace("6.0", "6.0004") + "[parameters]\nlate_s = 1.0\n"
    scenario = load(tmp_path, head + f"[[step]]\nat_s = {at}\nsync = true\n" + EXPECT)
    with pytest.raises(ConfigError, match=r":7:8: step\[1\].*: acts behind the last tick, at 6 s"):
        resolve_steps(scenario, MS, {"late_s": given})


def test_a_value_for_what_is_no_parameter_is_refused(tmp_path):
    scenario = load(tmp_path, WHOLE)
    with pytest.raises(
        ConfigError, match=r'"sag_ba" is not in \[parameters\]; the nearest is sag_bar'
    ):
        parameter_values(scenario, {"sag_ba": 1.0})


def test_a_course_comes_from_a_table(tmp_path):
    text = "\ufefftime_s;value\r\n\r\n0;0\r\n0,5;0,25\r\n"
    (tmp_path / "profile.csv").write_bytes(text.encode())
    step = '[[step]]\nat_s = 1\nset = "valve.spool_setpoint"\ntable = "profile.csv"\n'
    scenario = load(tmp_path, HEAD + step + EXPECT)
    action = resolve_steps(scenario, MS, {})[0].action
    assert action == SetAction("valve.spool_setpoint", 0.25, 0, ((0, 0.0), (500, 0.25)))


def test_a_course_may_name_parameters(tmp_path):
    (tmp_path / "profile.csv").write_text("time_s,value\n0,0\n0.5,peak_bar\n1,0\n")
    step = '[[step]]\nat_s = 1\nset = "io.0x6401.01"\ntable = "profile.csv"\n'
    head = HEAD + "[parameters]\npeak_bar = { value = 3.0, range = [1.0, 9.0] }\n"
    scenario = load(tmp_path, head + step + EXPECT)
    assert list(usage_problems(scenario)) == []
    action = resolve_steps(scenario, MS, parameter_values(scenario, {"peak_bar": 5.0}))[0].action
    assert action.course == ((0, 0.0), (500, 5e5), (1000, 0.0))


@pytest.mark.parametrize("late", ["1e9", "1e300", "1e308"])
def test_a_course_may_end_after_all_time(tmp_path, late):
    """In nanoseconds, 1e308 s are no number."""
    (tmp_path / "course.csv").write_text(f"0,0\n1,0\n{late},0\n")
    text = HEAD + '[[step]]\nat_s = 1\nset = "axis1.load"\ntable = "course.csv"\n' + EXPECT
    (step,) = resolve_steps(load(tmp_path, text), MS, {})
    assert step.action.course == ((0, 0.0), (1000, 0.0), (10**12, 0.0))


def test_a_course_with_points_between_thousands_is_refused(tmp_path):
    (tmp_path / "profile.csv").write_text("0;0,5\n0,5;1.234\n")
    step = '[[step]]\nat_s = 1\nset = "axis1.load"\ntable = "profile.csv"\n'
    with pytest.raises(ConfigError, match=r'profile.csv:2:5: "1.234" may be 1234 or 1.234 beside'):
        load(tmp_path, HEAD + step + EXPECT)


def test_a_course_with_an_unknown_name_is_refused(tmp_path):
    (tmp_path / "profile.csv").write_text("0,0\n0.5,peek_bar\n")
    step = '[[step]]\nat_s = 1\nset = "io.0x6401.01"\ntable = "profile.csv"\n'
    head = HEAD + "[parameters]\npeak_bar = 3.0\n"
    message = r"profile.csv:2:5: 'peek_bar' is no number; give one such as 0.5 or one of peak_bar"
    with pytest.raises(ConfigError, match=message):
        load(tmp_path, head + step + EXPECT)


INSIDE = "axis1.position +- 1 mm within 200 ms"
SPREADSHEET = f"""\ufefftitle;Extends;;;
duration_s;6,0

parameter;sag_bar;60;30;90
expect;R1;always axis1.P_A < 250 bar
;;;
time_s;valve.spool_setpoint;fault:drop_supply axis1 pressure_bar;sync;expect:{INSIDE}

0;0
0,5;-> 0,4;sag_bar
1,5;0,1;;off;100 mm
2;;for_s=0,5 pressure_bar=20
"""


def test_a_spreadsheet_is_the_same_scenario(tmp_path):
    found = load(tmp_path, SPREADSHEET.replace("\n", "\r\n"), "a.csv")
    assert found.duration == 6.0
    assert found.parameters == (Parameter("sag_bar", 60.0, (30.0, 90.0)),)
    sag = FaultStep(0.5, "drop_supply", "axis1", (("pressure_bar", Reference("sag_bar")),))
    assert found.steps == (
        SetStep(0.0, "valve.spool_setpoint", 0.0),
        SetStep(0.5, "valve.spool_setpoint", 0.4, 1.0),
        sag,
        SetStep(1.5, "valve.spool_setpoint", 0.1),
        SyncStep(1.5, is_on=False),
        FaultStep(2.0, "drop_supply", "axis1", (("for_s", 0.5), ("pressure_bar", 20.0))),
    )
    known = Vocabulary({"axis1.position": "m", "axis1.P_A": "Pa"})
    assert [each.id for each in compile_expectations(found, known)] == [
        "R1",
        "axis1.position at 1.5 s",
    ]
    assert found.expectations[1].that == (
        "always from 1.5 s to 1.5 s within 200 ms abs(axis1.position - 100 mm) <= 1 mm"
    )


@pytest.mark.parametrize("suffix", [".csv", ".scenario.toml"])
def test_a_file_reads_back_as_it_was(tmp_path, suffix):
    scenario = load(tmp_path, WHOLE)
    write_scenario(scenario, tmp_path / f"b{suffix}")
    assert load_scenario(tmp_path / f"b{suffix}") == scenario


WORDS = st.text(st.characters(exclude_categories=["C", "Z"]), min_size=1, max_size=8)
NUMBERS = st.floats(-1e6, 1e6)
TIMES = st.integers(0, 4999).map(lambda ms: (ms + 0.5) / 1000)  # never that of late_s
PARAMETERS = (Parameter("late_s", 1.0, (0.5, 2.0)), Parameter("p_bar", 20.0))
STEPS = st.one_of(
    st.builds(
        SetStep,
        st.one_of(TIMES, st.just(Reference("late_s"))),
        st.sampled_from(["valve.spool_setpoint", "axis1.load", "io.0x6411.01"]),
        st.one_of(NUMBERS, st.just(Reference("p_bar"))),
        st.one_of(st.just(0.0), st.floats(1e-3, 5), st.just(Reference("late_s"))),
    ),
    st.builds(
        FaultStep,
        TIMES,
        st.just("lose"),
        st.sampled_from(["valve", "position"]),
        st.fixed_dictionaries(
            {}, optional={"can_id": st.integers(0, 0x7FF), "share_percent": st.floats(0, 100)}
        ).map(lambda values: tuple(sorted(values.items()))),
    ),
    st.builds(NmtStep, TIMES, st.sampled_from(NmtVerb), st.just("valve")),
    st.builds(SyncStep, TIMES, st.booleans()),
    st.builds(FirmwareStep, TIMES, st.sampled_from(Power)),
)
SCENARIOS = st.builds(
    Scenario,
    st.just(Path("x")),
    WORDS,
    st.one_of(st.none(), WORDS),
    st.floats(5, 100),
    st.lists(WORDS, max_size=3).map(tuple),
    st.one_of(
        st.none(),
        st.builds(Controller, st.lists(WORDS, min_size=1, max_size=3).map(tuple)),
        st.builds(Controller, st.just(()), WORDS),
    ),
    st.just(PARAMETERS),
    st.lists(STEPS, max_size=5, unique_by=lambda each: (type(each), repr(each.at))).map(tuple),
    st.lists(
        st.builds(Expectation, WORDS, WORDS), min_size=1, max_size=3, unique_by=lambda e: e.id
    ).map(tuple),
)


@given(SCENARIOS)
@settings(max_examples=60, deadline=None)
def test_both_forms_read_back_as_they_were(tmp_path_factory, scenario):
    folder = tmp_path_factory.getbasetemp()
    for text, name in ((to_toml(scenario), "x.scenario.toml"), (to_csv(scenario), "x.csv")):
        assert load(folder, text, name) == scenario, text


@from_text("part", "wrong")
def test_a_bad_part_gets_one_line(tmp_path, part, wrong):
    found = refusal(tmp_path, f"{HEAD}{part}\n{EXPECT}")
    assert wrong in found
    assert "\n" not in found.replace("\na.scenario.toml:", "")


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        (HEAD, 'a.scenario.toml: checks nothing; give [[expect]] with id = "..."'),
        (EXPECT, "a.scenario.toml: title: missing; give for example title ="),
        (
            HEAD.replace("6.0", "1e6") + "[[step]]\nat_s = 1.2e6\nsync = true\n" + EXPECT,
            ":4:8: step[1].at_s: 1.2e+06 is out of range; give a number in s from 0 to 1e+06",
        ),
        (
            HEAD + f"[[step]]\nat_s = 1\nset = {{ a = 1{'0' * 400} }}\n" + EXPECT,
            f':5:7: step[1].set: "a": 1{"0" * 17}...{"0" * 18} is not finite; give a number',
        ),
        (
            HEAD + f"[[step]]\nat_s = 0x{'f' * 5000}\nsync = true\n" + EXPECT,
            f":4:8: step[1].at_s: 0x{'f' * 16}...{'f' * 18} is not finite",
        ),
        (HEAD + EXPECT + EXPECT, ':7:7: expect[2].id: "R1" is there twice; give each its own'),
        (HEAD + "x = [\n", "is not valid TOML"),
        ("[nodes.valve]\n", "a.scenario.toml: is a bench; give a scenario"),
        (b"\xff\xfe", "is not UTF-8 text"),
    ],
)
def test_bad_files_get_one_line(tmp_path, text, wrong):
    found = refusal(tmp_path, text)
    assert wrong in found
    assert "\n" not in found.replace("\na.scenario.toml:", "") or text == EXPECT


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("tilte,x\n", 'a.csv:1:1: "tilte" is unknown; the nearest known is title'),
        ("title\n", "a.csv:1:1: title has no value; give it in the next cell"),
        ("time_s,a\n,1\n", "a.csv:2:1: has no time; give it in the column time_s"),
        ("time_s,a\n0,1,2\n", "a.csv:2:5: has no column name above it; give it one"),
        ("time_s,a\n0,-> 1\n", "a.csv:2:3: ramps to the next row, and there is none"),
        ("time_s,sync\n0,yes\n", 'a.csv:2:3: "yes" is neither on nor off; give one of them'),
        ("time_s,fault:silence\n", "a.csv:1:8: give fault:KIND TARGET"),
        ("time_s,expect:x\n", "a.csv:1:8: is no expectation; give it as in expect:"),
        ("time_s,fault:silence valve\n0,1\n", "a.csv:2:3: give on, or keys as in"),
        ("parameter,x_bar\n", "a.csv:1:1: give parameter, name, value"),
        ("parameter,x_bar,9,1,5\n", "a.csv:1:17: parameters.x_bar"),
        (f"time_s,a\n0,1{'0' * 399}\n", f'"a": 1{"0" * 17}...{"0" * 18} is not finite'),
        (f"time_s,sync\n1{'0' * 5000},on\n", "step[1].at_s: inf is not finite"),
        (b"title,\xe4\n", "is not UTF-8 text; save it as CSV UTF-8"),
        ("", "a.csv: checks nothing"),
        (
            "title,T\nduration_s,6\nexpect,R,x > 1\ntime_s,sync\n7,on\n",
            "a.csv:5:1: step[1].at_s: 7 s",
        ),
    ],
)
def test_bad_tables_get_a_line_with_the_cell(tmp_path, text, wrong):
    assert wrong in refusal(tmp_path, text, "a.csv")


def test_expectations_are_refused_where_they_stand(tmp_path):
    lines = '[[expect]]\nid = "R2"\nthat = """\n  whenever flag > 0\n  then axis1.P_A < 3 mm"""\n'
    scenario = load(tmp_path, HEAD + EXPECT.replace("P_A", "P_a") + lines)
    known = Vocabulary({"axis1.P_A": "Pa", "flag": "-"})
    with pytest.raises(ConfigError) as error:
        compile_expectations(scenario, known)
    first, second = str(error.value).replace(f"{tmp_path}/", "").splitlines()
    assert first == (
        'a.scenario.toml:5:16: R1: "axis1.P_a" is no signal here; the nearest is axis1.P_A'
    )
    assert second.startswith("a.scenario.toml:10:20: R2: comparing (<)")


def test_windows_longer_than_the_run_are_refused(tmp_path):
    text = EXPECT.replace("always", "within 5 s always from 0 s to 2 s")
    scenario = load(tmp_path, HEAD + text)
    with pytest.raises(ConfigError, match=r":5:9: R1: needs 7 s to be decided, .* lasts 6 s"):
        compile_expectations(scenario, Vocabulary({"axis1.P_A": "Pa"}))


@pytest.mark.parametrize(("ago", "is_refused"), [(4, False), (4.001, True)])
def test_a_window_back_beyond_the_beginning_is_refused(tmp_path, ago, is_refused):
    """2 s and 4 s ago are the 6 s of the run; with a tick more it would hold no tick."""
    back = f"always once from 2 s to 3 s historically from {ago} s to 9 s axis1.P_A < 1 bar"
    text = EXPECT.replace("always axis1.P_A < 250 bar", back)
    scenario, known = load(tmp_path, HEAD + text), Vocabulary({"axis1.P_A": "Pa"})
    if not is_refused:
        assert len(compile_expectations(scenario, known)) == 1
        return
    with pytest.raises(ConfigError, match=r":5:9: R1: looks back 6\.001 s, .* lasts 6 s"):
        compile_expectations(scenario, known)


def test_a_requirement_of_10000_characters_is_refused_where_it_stands(tmp_path):
    """docs/expectations.md: at most 4000 characters."""
    text = EXPECT.replace("axis1.P_A", "axis1.P_A + 0 bar" + " + 0 bar" * 1250)
    scenario = load(tmp_path, HEAD + text)
    with pytest.raises(ConfigError, match=r":5:9: R1: has 10\d{3} characters; give at most 4000"):
        compile_expectations(scenario, Vocabulary({"axis1.P_A": "Pa"}))


def test_nested_windows_add_up_until_they_are_longer_than_the_run(tmp_path):
    """3 s and 2 s and 1 s are the 6 s of the run; a tick more is not."""
    known = Vocabulary({"axis1.P_A": "Pa"})
    nested = "always from 0 s to 3 s within {} s axis1.P_A < 250 bar for 1 s"
    for inner, is_refused in ((2, False), (2.001, True)):
        text = EXPECT.replace("always axis1.P_A < 250 bar", nested.format(inner))
        scenario = load(tmp_path, HEAD + text)
        if is_refused:
            with pytest.raises(ConfigError, match=r":5:9: R1: needs 6\.001 s to be decided"):
                compile_expectations(scenario, known)
        else:
            assert len(compile_expectations(scenario, known)) == 1


def test_the_language_takes_the_parameters_of_the_scenario(tmp_path):
    text = EXPECT.replace("250 bar", "sag_bar")
    scenario = load(tmp_path, HEAD + "[parameters]\nsag_bar = 60\n" + text)
    known = Vocabulary({"axis1.P_A": "Pa"}, parameters=parameter_values(scenario))
    (found,) = compile_expectations(scenario, known)
    assert found.condition.operand.right.value == 60e5


def test_a_byte_order_mark_does_not_shift_the_place_of_a_problem(make_file):
    path = make_file("a.scenario.toml", b"\xef\xbb\xbfduration_s = 0\n" + EXPECT.encode())
    with pytest.raises(ConfigError, match=r"a\.scenario\.toml:1:14: duration_s: 0 is out of range"):
        load_scenario(path)
