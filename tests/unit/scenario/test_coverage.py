"""How much of its time a verdict has seen, by the rules of docs/expectations.md."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.expectations import TICK, VOCABULARY, random_case, random_trace

from hil_bench.abilities.scenario.examination import Examination
from hil_bench.abilities.scenario.judgement import judge, show_seen
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.monitor import Monitor
from hil_bench.abilities.scenario.nodes import Vocabulary
from hil_bench.abilities.scenario.parse import parse_expectation
from hil_bench.abilities.scenario.recorded import lay_on_ticks
from hil_bench.abilities.scenario.results import reason_of
from hil_bench.abilities.scenario.run import PlayOptions, play, prepare
from hil_bench.cli import main
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import Channel, recording_dtype

KNOWN = Vocabulary({"p": "-", "q": "-"}, has_frames=True)
NAN = math.nan
LIMIT = 'id = "R1"\nthat = "always axis1.P_A < 250 bar"\n'
SEEDS = st.integers(0, 2**32)


def verdict(text, p, q=None, planned=None):
    """Return what a run with a tick of 1 ms says."""
    columns = {"p": np.array(p, float), "q": np.array(q or [0.0] * len(p), float)}
    condition = parse_expectation(text, KNOWN)
    return judge(condition, columns, ticks=len(p), tick_ns=1_000_000, planned=planned)


def covered(found):
    """Return first and last tick of its time, and how many ticks were seen and unknown."""
    coverage = found.coverage
    return [
        round(each * 1000, 6)
        for each in (coverage.start, coverage.end, coverage.seen, coverage.unknown)
    ]


@pytest.mark.parametrize(
    ("text", "outcome", "asked"),
    [
        # Ticks 0 to 3 were seen of 0 to 9; p is 1, 1, 5, 1 there. First and last tick of its time,
        # ticks of it that were seen and that are unknown, all counted by hand from the document.
        ("always p < 9", "inconclusive", [0, 9, 3, 6]),
        ("always p < 4", "failed", [0, 9, 3, 6]),
        ("eventually p > 4", "passed", [0, 9, 3, 6]),
        ("eventually p > 9", "inconclusive", [0, 9, 3, 6]),
        ("not eventually p > 9", "inconclusive", [0, 9, 3, 6]),
        ("always from 1 ms to 3 ms p < 9", "passed", [1, 3, 2, 0]),
        ("always from 1 ms to 5 ms p < 9", "inconclusive", [1, 5, 2, 2]),
        ("always from 5 ms to 7 ms p < 9", "inconclusive", [5, 7, 0, 3]),
        ("always after 2 ms p < 9", "inconclusive", [2, 9, 1, 6]),
        ("p < 9", "passed", [0, 0, 0, 0]),
        ("p < 9 for 2 ms", "passed", [0, 2, 2, 0]),
        ("always (p < 9 for 2 ms)", "inconclusive", [0, 9, 3, 6]),
        ("always from 0 ms to 2 ms (p < 9 for 2 ms)", "inconclusive", [0, 4, 3, 1]),
        ("always from 2 ms to 4 ms (p < 9 for the last 1 ms)", "inconclusive", [1, 4, 2, 1]),
        ("always from 2 ms to 4 ms (once from 1 ms to 2 ms p < 9)", "passed", [0, 3, 3, 0]),
        ("always from 2 ms to 3 ms (historically p < 9)", "passed", [0, 3, 3, 0]),
        ("always from 2 ms to 4 ms previous(p < 9)", "passed", [1, 3, 2, 0]),
        ("always from 2 ms to 3 ms not rises(p > 9)", "passed", [1, 3, 2, 0]),
        ("p < 9 until p > 4", "passed", [0, 9, 3, 6]),
        ("p < 9 until within 2 ms p > 4", "passed", [0, 2, 2, 0]),
        ("p < 9 until from 2 ms to 5 ms p > 7", "inconclusive", [0, 5, 3, 2]),
        ("always from 3 ms to 3 ms (p < 9 since within 2 ms p > 4)", "passed", [1, 3, 2, 0]),
        ("(always from 1 ms to 2 ms p < 9) and always from 7 ms to 8 ms p < 9", "inconclusive",
         [1, 8, 5, 2]),
        ("(always from 5 ms to 6 ms p < 9) and always from 7 ms to 8 ms p < 9", "inconclusive",
         [5, 8, 0, 4]),
        ("(always from 5 ms to 7 ms p < 9) and always from 6 ms to 8 ms p < 9", "inconclusive",
         [5, 8, 0, 4]),
        ("whenever p > 4 then within 1 ms p < 2", "inconclusive", [0, 9, 3, 6]),
        # One of two implications never triggers.
        ("always from 0 ms to 2 ms ((p > 0 implies p < 9) and (p > 9 implies p < 2))",
         "not exercised", [0, 2, 2, 0]),
        ("always from 0 ms to 2 ms (p > 9 implies p < 2)", "not exercised", [0, 2, 2, 0]),
        ("settled(p, 1)", "failed", [0, 9, 3, 6]),
    ],
)  # fmt: skip
def test_what_was_not_seen_is_unknown(text, outcome, asked):
    found = verdict(text, [1, 1, 5, 1], planned=10)
    assert (found.outcome, covered(found)) == (outcome, asked)
    assert found.coverage.is_stated


@pytest.mark.parametrize(
    ("text", "p", "q", "outcome", "asked", "reason"),
    [
        ("always p < 9", [NAN, 1, NAN, 1, 1, NAN], None, "inconclusive", [0, 5, 2, 3],
         "p not seen before 0.001 s; p not seen for 0.001 s; p not seen after 0.004 s"),
        ("always p < 9", [NAN, NAN, NAN], None, "inconclusive", [0, 2, 0, 3], "p not seen"),
        ("always p < 9", [NAN, 9, NAN], None, "failed", [0, 2, 0, 2], ""),
        ("always (p < 9 or q < 9)", [1, NAN, 1], [1, 1, 1], "passed", [0, 2, 1, 1],
         "p, q never changed where it was seen"),
        ("always (p < 9 and q < 9)", [1, NAN, 1], [NAN, 1, 1], "inconclusive", [0, 2, 0, 2],
         "p, q not seen before 0.002 s"),
        ("always from 0 ms to 1 ms p < 9", [1, NAN, 1], None, "inconclusive", [0, 1, 0, 1],
         "p not seen after 0 s"),
        # What is missing where nobody asks for it counts for nothing.
        ("always from 1 ms to 2 ms p < 9", [NAN, 1, 1, NAN], None, "passed", [1, 2, 1, 0],
         "p never changed where it was seen"),
        ("(always from 0 ms to 1 ms p < 9) and always from 3 ms to 4 ms q < 9",
         [1, 1, NAN, NAN, NAN], [NAN, NAN, NAN, 1, 2], "passed", [0, 4, 4, 0], ""),
        # The window reaches beyond the end, and all that there was is known.
        ("whenever p > 4 then within 2 ms p > 6", [1, 1, 5], None, "inconclusive", [0, 2, 2, 0],
         "the run ends before it is decided"),
    ],
)  # fmt: skip
def test_a_hole_is_unknown_where_it_is_asked_for(text, p, q, outcome, asked, reason):
    found = verdict(text, p, q, planned=len(p))
    assert (found.outcome, covered(found), found.reason) == (outcome, asked, reason)


def test_beside_a_hole_what_is_known_decides():
    """The trigger is true by 0.1 of 1 whatever q is; the response misses by 8.9 of 9."""
    found = verdict("always ((p > 0 or q > 0) implies p > 9)", [0.1], [NAN])
    assert (found.outcome, found.margin) == ("failed", pytest.approx(-0.1))
    assert found.deciding.condition == "not p > 0"
    found = verdict("always not ((p > 0 or q > 0) implies p > 9)", [0.1], [NAN])
    assert (found.outcome, found.margin) == ("passed", pytest.approx(0.1))
    assert found.deciding.condition == "p > 0"


def test_a_hole_is_no_change():
    assert (
        verdict("always after 2 ms p < 9", [1, NAN, 1, 1]).reason
        == "p never changed where it was seen"
    )


def test_a_hole_and_an_early_end_are_both_named():
    found = verdict("always (p < 9 and q < 9)", [1, 1, 1, NAN], [1] * 4, planned=10)
    assert found.reason == "p not seen after 0.002 s; nothing seen after 0.003 s"
    assert verdict("always p < 9", [], planned=10).reason == "nothing seen"


@pytest.mark.parametrize(
    ("text", "is_stated", "words"),
    [
        ("always p < 9", False, "seen 0.003 of 0.003 s, to the last row"),
        ("always after 9 ms p < 9", False, "not seen at 0.009 s"),
        ("always from 1 ms to 5 ms p < 9", True, "seen 0.002 of 0.004 s"),
        ("p < 9 for 2 ms and always p < 9", False, "seen 0.003 of 0.003 s, to the last row"),
        ("p < 9", True, "seen at 0 s"),
    ],
)
def test_without_a_plan_the_end_is_that_of_the_rows(text, is_stated, words):
    found = verdict(text, [1, 1, 5, 1])
    assert found.coverage.is_stated is is_stated
    assert str(found.coverage) == words
    assert reason_of(found).endswith(words)


def test_the_share_that_was_seen():
    assert verdict("always p < 9", [1, 1, 1], planned=9).coverage.share == 0.25  # 2 of 8 ms
    found = verdict("always from 1 ms to 5 ms p < 9", [1, 1, 5, 1])
    assert found.coverage.share == 0.5  # 2 of 4 ms
    assert verdict("p < 9", [1], planned=9).coverage.share == 1.0
    assert verdict("p < 9", [NAN], planned=9).coverage.share == 0.0
    # In floating point 2.0 - 1.8 is less than 0.2, and 0.3 - 0.1 too.
    late = verdict("always after 1.8 s p < 9", [1] * 2001, planned=2001)
    assert (covered(late), late.coverage.share) == ([1800, 2000, 200, 0], 1.0)
    most = verdict("always after 1.8 s p < 9", [1] * 2000 + [NAN], planned=2001)
    assert 0.99 < most.coverage.share < 1.0
    shown = [show_seen(share) for share in (1.0, 0.9996, 0.5, 0.0)]
    assert shown == ["100 %", "99.9 %", "50 %", "0 %"]


def test_ticks_behind_the_plan_do_not_count():
    assert verdict("always p < 4", [1, 1, 5, 5], planned=2).outcome == "passed"
    assert covered(verdict("always p < 4", [1, 1, 5, 5], planned=3)) == [0, 2, 2, 0]


@given(SEEDS)
@settings(max_examples=60, deadline=None)
def test_a_long_time_that_was_not_seen_is_as_good_as_a_short_one(seed):
    """An examination does not compute 10 h of nothing; a monitor that gets them all agrees."""
    rng = np.random.default_rng(seed)
    node = parse_expectation(random_case(rng, int(rng.integers(0, 6))).ours, VOCABULARY)
    ticks, unseen = int(rng.integers(1, 20)), 2000
    columns = random_trace(rng, ticks, holes=0.05)
    monitor = Monitor(node, TICK)
    monitor.push(
        {name: np.append(each, np.full(unseen, NAN)) for name, each in columns.items()},
        ticks + unseen,
    )
    monitor.finish()
    found = Examination(node, columns, ticks, TICK, ticks + unseen)
    assert found.values.size < ticks + unseen
    assert found.monitor.margin == monitor.margin
    far = Examination(node, columns, ticks, TICK, 10**12)
    assert far.monitor.margin == monitor.margin


def test_a_violation_lasts_as_long_as_it_was_seen():
    """A past that is wrong stays so behind the end, which is no time that anybody saw."""
    found = verdict("always historically p < 4", [1, 1, 5, 1], planned=1000)
    assert (found.outcome, found.first, found.duration) == ("failed", 0.002, 0.001)
    found = verdict("always historically from 2 ms to 3 ms p < 4", [1, 1, 5, 1], planned=1000)
    assert (found.outcome, found.first, found.duration) == ("failed", 0.004, 0.0)
    columns = {"p": np.array([1.0, 1.0, 5.0, 1.0])}
    condition = parse_expectation("always historically p < 4", KNOWN)
    assert Examination(condition, columns, 4, TICK, 1000).violated_spans() == [(2, 3)]


def recording(times):
    dtype = recording_dtype([Channel("time", "s"), Channel("p", "Pa")])
    return np.array([(time, number) for number, time in enumerate(times)], dtype=dtype)


@pytest.mark.parametrize(
    ("times", "start", "duration", "column", "planned", "begin"),
    [
        ([5.0, 5.1, 5.2], None, None, [0, 1, 2], None, 5.0),
        ([5.0, 5.1, 5.2], 5.1, None, [1, 2], None, 5.1),
        ([5.0, 5.1, 5.2], 4.9, None, [NAN, 0, 1, 2], None, 4.9),
        ([0.0, 0.1, 0.2], None, 0.4, [0, 1, 2], 5, 0.0),
        ([0.0, 0.1, 0.2], None, 0.1, [0, 1], 2, 0.0),
        ([0.0, 0.1, 0.2], None, 0.19, [0, 1], 2, 0.0),
        ([-0.1, 0.0, 0.1], None, 0.4, [1, 2], 5, 0.0),
        ([0.2, 0.3, 0.4], None, 0.3, [NAN, NAN, 0, 1], 4, 0.0),
        ([7.0, 7.1, 7.2], 7.0, 0.2, [0, 1, 2], 3, 7.0),
        ([7.0, 7.1, 7.2], None, 0.2, [], 3, 0.0),
        ([7.0, 7.1, 7.2], 9.0, 0.2, [], 3, 9.0),
        ([0.03, 0.13, 0.23], None, 0.2, [0, 1, 2], 3, 0.03),
        ([0.08, 0.18], None, 0.2, [NAN, 0, 1], 3, -0.02),
    ],
)
def test_rows_lie_on_the_ticks_of_the_run(times, start, duration, column, planned, begin):
    found = lay_on_ticks(recording(times), "r", start, duration)
    np.testing.assert_array_equal(found.columns["p"], column)
    assert (found.ticks, found.tick_ns, found.planned) == (len(column), 100_000_000, planned)
    assert found.start == pytest.approx(begin)


@pytest.mark.parametrize(("rows", "hertz"), [(3, 1000), (2001, 1000), (90_001, 8), (501, 4096)])
def test_times_since_1970_lie_on_the_ticks_that_their_writer_had(rows, hertz):
    """A double has steps of 0.24 us there; that in ns is what the bench calls a tick."""
    times = [1_732_700_000 + row / hertz for row in range(rows)]
    found = lay_on_ticks(recording(times), "r")
    assert (found.tick_ns, found.ticks) == (round(1e9 / hertz), rows)


@pytest.mark.parametrize("hertz", [25_600, 48_000])
def test_an_interval_of_no_whole_nanoseconds_is_a_grid(hertz):
    """Rounded to 39062 and 20833 ns, five seconds are a tick or more short at their end."""
    rows = 5 * hertz
    found = lay_on_ticks(recording([row / hertz for row in range(rows)]), "r")
    assert (found.tick_ns, found.ticks) == (1_000_000_000 // hertz, rows)
    short = (rows - 1) * (1e9 / hertz - found.tick_ns) * 1e-6
    assert short > found.tick_ns * 1e-6
    assert found.note.startswith(f"its rows are up to {short:.3g} ms off ticks of")


def test_times_since_1970_are_said_to_the_microsecond():
    times = recording([1_732_700_000.0, 1_732_700_000.5])
    said = lay_on_ticks(times, "r", 0.0, 1.0).note
    assert said.startswith("its rows are from 1732700000 to 1732700000.5 s; judged are 0 to 1 s")


def test_a_start_that_is_far_off_has_nothing_or_too_much():
    for start in (1e300, -1e300):
        found = lay_on_ticks(recording([0.0, 0.1]), "r", start, 0.2)
        assert (found.ticks, found.planned) == (0, 3)
    assert lay_on_ticks(recording([0.0, 0.1]), "r", 1e300).ticks == 0
    with pytest.raises(ConfigError, match="give at most 100000000"):
        lay_on_ticks(recording([0.0, 0.1]), "r", -1e300)


def test_two_rows_of_one_tick_are_refused():
    for times in ([0.0, 0.1, 0.1, 0.2], [0.0, 0.1, 0.2, 0.3, 0.301, 0.4]):
        with pytest.raises(ConfigError):
            lay_on_ticks(recording(times), "r")


def judged(tmp_path, capsys, head, seconds, *options, begin=0.0, wrong_at=math.inf):
    """Return exit code and lines of a recording with a row each 10 ms, of `seconds`."""
    (tmp_path / "r.toml").write_text(f"{head}[[expect]]\n{LIMIT}")
    rows = [
        f"{begin + k / 100},{3e7 if k / 100 >= wrong_at else 2e7}\n"
        for k in range(round(seconds * 100) + 1)
    ]
    (tmp_path / "run.csv").write_text("time,axis1.P_A\ns,Pa\n" + "".join(rows))
    code = main(["judge", str(tmp_path / "r.toml"), str(tmp_path / "run.csv"), *options])
    return code, capsys.readouterr().out


def test_one_second_of_six_is_inconclusive(tmp_path, capsys):
    """As an examiner found it: the violation comes at 3 s, and the recording has 1 s."""
    head = 'title = "T"\nduration_s = 6.0\n'
    code, out = judged(tmp_path, capsys, head, 6.0, wrong_at=3.0)
    assert code == ExitCode.CHECK_FAILED
    assert "seen 6 of 6 s" in out
    code, out = judged(tmp_path, capsys, head, 1.0, wrong_at=3.0)
    assert code == ExitCode.INCONCLUSIVE
    assert out.splitlines()[1] == "  R1  inconclusive   nothing seen after 1 s; seen 1 of 6 s"
    code, out = judged(tmp_path, capsys, head, 1.0, wrong_at=0.5)
    assert code == ExitCode.CHECK_FAILED
    assert "first violated at 0.5 s, for 0.5 s in all" in out
    assert out.rstrip().endswith("seen 1 of 6 s")


def test_requirements_alone_may_say_their_time(tmp_path, capsys):
    code, out = judged(tmp_path, capsys, "", 1.0)
    assert code == ExitCode.DONE
    assert out.rstrip().endswith("seen 1 of 1 s, to the last row")
    code, out = judged(tmp_path, capsys, "duration_s = 6.0\n", 1.0)
    assert code == ExitCode.INCONCLUSIVE
    code, out = judged(tmp_path, capsys, "duration_s = 6.0\n", 6.0, "--json")
    assert code == ExitCode.DONE
    ((found,),) = json.loads(out).values()
    assert found["judgement"]["coverage"] == {
        "start": 0.0, "end": 6.0, "seen": 6.0, "unknown": 0.0, "is_stated": True,
    }  # fmt: skip
    assert found["text"].endswith("seen 6 of 6 s")


def test_a_time_that_is_none_is_refused(tmp_path, capsys, cli):
    (tmp_path / "r.toml").write_text(f"duration_s = -1.0\n[[expect]]\n{LIMIT}")
    (tmp_path / "run.csv").write_text("time,axis1.P_A\ns,Pa\n0,1\n1,1\n")
    assert main(["judge", str(tmp_path / "r.toml"), str(tmp_path / "run.csv")]) == ExitCode.USAGE
    assert "r.toml:1:14: duration_s: " in capsys.readouterr().err
    text = LIMIT.replace("always", "always from 1 s to 7 s")
    (tmp_path / "r.toml").write_text(f"duration_s = 6.0\n[[expect]]\n{text}")
    assert main(["judge", str(tmp_path / "r.toml"), str(tmp_path / "run.csv")]) == ExitCode.USAGE
    assert "needs 7 s to be decided" in capsys.readouterr().err
    words = ["judge", str(tmp_path / "r.toml"), str(tmp_path / "run.csv"), "--start", "inf"]
    assert "inf: give a time in s, such as 12.5" in cli(words, ExitCode.USAGE).err


def test_a_recording_that_starts_late_lacks_the_beginning(tmp_path, capsys):
    head = "duration_s = 1.0\n"
    code, out = judged(tmp_path, capsys, head, 1.0, begin=0.25)
    assert code == ExitCode.INCONCLUSIVE
    assert out.splitlines()[1:] == [
        "  its rows are from 0.25 to 1.25 s; judged are 0 to 1 s, --start S says where that begins",
        "  R1  inconclusive   axis1.P_A not seen before 0.25 s; seen 0.75 of 1 s",
    ]
    code, out = judged(tmp_path, capsys, head, 1.0, "--start", "0.25", begin=0.25)
    assert code == ExitCode.DONE
    assert "its rows are" not in out


def test_a_run_that_ends_at_a_failure_leaves_the_others_open(tmp_path):
    path = tmp_path / "a.scenario.toml"
    texts = ["always axis1.P_A < 250 bar", "always axis1.P_A < 1 bar", "axis1.P_A > 1 bar"]
    tables = [f'[[expect]]\nid = "R{n}"\nthat = "{text}"\n' for n, text in enumerate(texts)]
    path.write_text('title = "T"\nduration_s = 2.0\n' + "".join(tables))
    run = play(
        prepare(load_scenario(path)), PlayOptions(stops_at_failure=True, keeps_evidence=True)
    )
    assert run.is_early
    outcomes = [each.judgement.outcome for each in run.findings]
    assert outcomes == ["inconclusive", "failed", "passed"]
    assert {each.judgement.coverage.end for each in run.findings} == {2.0, 0.0}
    assert run.findings[0].judgement.coverage.seen == pytest.approx(run.duration)
    assert run.evidence.planned == 2001
