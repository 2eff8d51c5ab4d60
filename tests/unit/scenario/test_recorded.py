"""Requirements held against recordings, and the verbs that do it."""

import json

import numpy as np
import pytest

from hil_bench.abilities.scenario.nodes import channel_vocabulary
from hil_bench.abilities.scenario.recorded import Trace, judge_trace, lay_on_ticks
from hil_bench.abilities.scenario.records import Expectation
from hil_bench.abilities.scenario.resolve import compile_texts
from hil_bench.cli import main
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import Channel, recording_dtype

HEAD = "time,axis1.P_A\ns,Pa\n"
PASSES = '[[expect]]\nid = "R1"\nthat = "always axis1.P_A < 250 bar"\n'
OPEN = '[[expect]]\nid = "R2"\nthat = "always from 0 s to 9 s axis1.P_A > 0"\n'


def recording(*rows):
    dtype = recording_dtype([Channel("time", "s"), Channel("p", "Pa")])
    return np.array(list(rows), dtype=dtype)


def judge(tmp_path, requirements, rows, *options):
    (tmp_path / "r.toml").write_text(requirements)
    lines = [f"{k / 1000},{value}\n" for k, value in enumerate(rows)]
    (tmp_path / "run.csv").write_text(HEAD + "".join(lines))
    return main(["judge", str(tmp_path / "r.toml"), str(tmp_path / "run.csv"), *options])


def test_a_missing_row_is_unknown():
    found = lay_on_ticks(recording((5.0, 1.0), (5.001, 2.0), (5.002, 4.0), (5.004, 3.0)), "r")
    assert (found.ticks, found.tick_ns) == (5, 1_000_000)
    np.testing.assert_array_equal(found.columns["p"], [1.0, 2.0, 4.0, np.nan, 3.0])


@pytest.mark.parametrize(
    ("times", "wrong"),
    [
        ([0.0, 0.0], "the time does not go on in row 2: 0 s, and then 0 s; give rising times"),
        ([0.0, 2.0, 1.5, 3.0], "the time does not go on in row 3: 2 s, and then 1.5 s"),
        ([0.0, float("nan")], "the time of row 2 is no number"),
        ([0.0, 1.0, 1.1, 2.0, 3.0], "not evenly spaced"),  # two rows of one tick
        ([0.0, 1.0, 2.0, 3.0, 4.6, 5.0, 6.0, 6.6], "not evenly spaced, as at 4.6 s"),
        ([0.0, 1e-12, 2e-12], "not evenly spaced"),
        ([0.0, 1e-9, 2e-9, 1e3], "spans 1000000000001 ticks"),
    ],
)
def test_a_recording_without_a_grid_is_refused(times, wrong):
    with pytest.raises(ConfigError, match=wrong):
        lay_on_ticks(recording(*((time, 0.0) for time in times)), "r")


@pytest.mark.parametrize("rows", [0, 1])
def test_a_recording_without_rows_shows_nothing_and_hides_no_other(tmp_path, cli, rows):
    empty, full, wrong = (tmp_path / f"{name}.csv" for name in ("empty", "full", "wrong"))
    empty.write_text("time,axis1.P_A\ns,Pa\n" + "0,1\n" * rows)
    full.write_text("time,axis1.P_A\ns,Pa\n0,1\n1,3e7\n")
    wrong.write_text("time,axis1.P_A\ns,Pa\n0,1\n1,\n")
    requirements = tmp_path / "r.toml"
    requirements.write_text(PASSES)
    said = cli(["judge", str(requirements), str(empty)], ExitCode.INCONCLUSIVE)
    assert f"{empty}: has {rows} rows; give a recording of two or more" in said.err
    said = cli(["judge", str(requirements), str(empty), str(wrong), str(full)], 1)
    assert said.err.count("\n") == 2
    assert "R1  failed" in said.out
    requirements.write_text("duration_s = -1.0\n" + PASSES)
    said = cli(["judge", str(requirements), str(full), str(full)], ExitCode.USAGE)
    assert (said.err.count("\n"), said.out) == (1, "")


def test_rows_that_jitter_keep_their_values_and_say_how_far_they_are_off():
    """Rows are up to 0.4 of a tick late, by a clock that is 1 % slow; two ticks have none."""
    late = {0: 0.0, 1: 0.2, 2: 0.4, 3: 0.3, 5: 0.1, 6: 0.0, 7: -0.2, 8: -0.4, 9: -0.2, 11: 0.0}
    times = [1.01e-3 * (tick + share) for tick, share in late.items()]
    found = lay_on_ticks(recording(*((time, value) for value, time in enumerate(times))), "r")
    values = [0.0, 1.0, 2.0, 3.0, np.nan, 4.0, 5.0, 6.0, 7.0, 8.0, np.nan, 9.0]
    np.testing.assert_array_equal(found.columns["p"], values)
    assert found.tick_ns == 1_010_000
    assert found.note == (
        "its rows are up to 0.404 ms off ticks of 1.01 ms, and so are the times of a verdict"
    )


def test_the_verb_says_what_decides(tmp_path, capsys):
    assert judge(tmp_path, PASSES, [1e5, 245e5]) == ExitCode.DONE
    line = capsys.readouterr().out.splitlines()[1]
    assert line == (
        "  R1  passed         closest at 0.001 s: axis1.P_A was 245 bar, 5 bar below 250 bar "
        "(+0.02 of the tolerance); seen 0.001 of 0.001 s, to the last row"
    )


def test_nothing_is_violated_for_longer_than_it_was_seen(tmp_path, cli):
    """Three rows a second apart are two seconds, whichever of them are wrong."""
    requirements, recording = tmp_path / "r.toml", tmp_path / "run.csv"
    requirements.write_text('[[expect]]\nid = "R"\nthat = "always axis1.P_A < 250 bar"\n')
    for values, lasts in (
        ((3e7, 3e7, 3e7), "2 s"),
        ((3e7, 3e7, 1e7), "2 s"),
        ((1e7, 3e7, 3e7), "1 s"),
    ):
        rows = [f"{time},{value}" for time, value in enumerate(values)]
        recording.write_text("\n".join(["time,axis1.P_A", "s,Pa", *rows]) + "\n")
        out = cli(["judge", str(requirements), str(recording)], ExitCode.CHECK_FAILED).out
        assert f", for {lasts} in all; " in out
        assert "seen 2 of 2 s" in out


def test_parameters_are_those_of_the_run(tmp_path, cli):
    requirements, recording = tmp_path / "r.toml", tmp_path / "run.csv"
    limit = "[parameters]\nlimit_bar = 250.0\n"
    requirements.write_text(limit + PASSES.replace("250 bar", "limit_bar"))
    recording.write_text(HEAD + "0,2e7\n1,2e7\n")
    words = ["judge", str(requirements), str(recording)]
    assert "R1  passed" in cli(words).out
    assert "R1  failed" in cli([*words, "--set", "limit_bar=190"], ExitCode.CHECK_FAILED).out
    said = cli([*words, "--set", "limt_bar=190"], ExitCode.USAGE).err
    assert '"limt_bar" is not in [parameters]; the nearest is limit_bar' in said


def test_a_failure_counts_before_what_is_open(tmp_path, capsys):
    assert judge(tmp_path, PASSES + OPEN, [1e5, 245e5]) == ExitCode.INCONCLUSIVE
    assert judge(tmp_path, PASSES + OPEN, [1e5, 260e5]) == ExitCode.CHECK_FAILED
    assert "first violated at 0.001 s; worst at 0.001 s" in capsys.readouterr().out


def test_json_has_the_judgement(tmp_path, capsys):
    judge(tmp_path, PASSES, [1e5, 260e5], "--json")
    ((found,),) = json.loads(capsys.readouterr().out).values()
    assert found["id"] == "R1"
    assert found["judgement"]["outcome"] == "failed"
    assert found["judgement"]["margin"] == pytest.approx(-0.04)  # 10 of 250 bar


def test_json_says_each_requirement_undecided_of_a_recording_that_cannot_be_judged(tmp_path, cli):
    (tmp_path / "r.toml").write_text(PASSES + OPEN)
    (tmp_path / "whole.csv").write_text(HEAD + "0,1e5\n9,1e5\n")
    (tmp_path / "torn.csv").write_text(HEAD + "0,1e5\n9,\n")
    names = [str(tmp_path / name) for name in ("r.toml", "whole.csv", "torn.csv")]
    said = cli(["judge", *names, "--json"], ExitCode.USAGE)
    content = json.loads(said.out)
    assert list(content) == names[1:]
    outcomes = {(each["id"], each["judgement"]["outcome"]) for each in content[names[2]]}
    assert outcomes == {("R1", "inconclusive"), ("R2", "inconclusive")}
    assert all(f"error: {each['text']}" in said.err for each in content[names[2]])


def test_what_a_file_names_and_does_not_judge_is_undecided(tmp_path, capsys):
    named = 'requirement_ids = ["R1", "R9"]\n'
    assert judge(tmp_path, named.replace(', "R9"', "") + PASSES, [1e5, 1e5]) == ExitCode.DONE
    assert "not judged" not in capsys.readouterr().out
    assert judge(tmp_path, named + PASSES, [1e5, 1e5]) == ExitCode.INCONCLUSIVE
    assert "R9  not judged     requirement_ids names it" in capsys.readouterr().out
    assert judge(tmp_path, named + PASSES, [1e5, 3e7]) == ExitCode.CHECK_FAILED


def test_a_requirement_on_frames_is_refused(tmp_path, capsys):
    text = PASSES.replace("axis1.P_A < 250 bar", "not frame(0x181)")
    assert judge(tmp_path, text, [1, 2]) == ExitCode.USAGE
    assert "r.toml:3:20: R1: there are no frames here" in capsys.readouterr().err


def test_a_scenario_is_checked_listed_and_converted(tmp_path, capsys, cli):
    path, table = tmp_path / "a.scenario.toml", tmp_path / "a.csv"
    path.write_text('title = "T"\nduration_s = 1.0\n' + PASSES)
    assert main(["scenario", "convert", str(path), str(table)]) == ExitCode.DONE
    assert main(["scenario", "check", str(path), str(table)]) == ExitCode.DONE
    out = cli(["scenario", "list", str(table)]).out
    assert out.count("ok; 1 s, 0 steps, 1 requirement") == 2
    assert "  R1  always axis1.P_A < 250 bar" in out
    assert main(["scenario", "convert", str(path), str(table)]) == ExitCode.USAGE
    said = capsys.readouterr().err
    assert "is there already" in said
    assert "cannot fail" not in said
    path.write_text(path.read_text().replace("250 bar", "5000 bar"))
    assert f"{path}: R1: cannot fail: " in cli(["scenario", "check", str(path)]).err


def test_all_bad_scenarios_are_told_at_once(tmp_path, capsys):
    paths = [tmp_path / "a.toml", tmp_path / "b.toml"]
    for path in paths:
        path.write_text('title = "T"\nduration_s = 1.0\n' + PASSES.replace("P_A", "P_a"))
    assert main(["scenario", "check", *map(str, paths)]) == ExitCode.USAGE
    assert capsys.readouterr().err.count("the nearest is axis1.P_A") == 2


def test_only_missing_values_of_its_own_are_told():
    names = ("axis1.P_A", "axis1.P_B")
    known = channel_vocabulary([Channel(name, "Pa") for name in names])
    (requirement,) = compile_texts([Expectation("R", "always axis1.P_A < 250 bar")], known)
    trace = Trace({name: np.array([1.0, np.nan]) for name in names}, 2, 1_000_000)
    reason = judge_trace(requirement, trace).judgement.reason
    assert reason == "axis1.P_A not seen after 0 s"


def test_a_table_of_another_tool_is_judged_by_the_names_that_a_map_gives(tmp_path, capsys, cli):
    """At 1 ms CH1 shows 260 bar."""
    (tmp_path / "r.toml").write_text(PASSES)
    (tmp_path / "scope.csv").write_text("t;CH1\n0;1,5\n1;260,0\n")
    files = ["judge", str(tmp_path / "r.toml"), str(tmp_path / "scope.csv")]

    assert main([*files, "--map", "t=time:ms", "--map", "CH1=P_A:bar"]) == ExitCode.CHECK_FAILED
    assert "worst at 0.001 s: axis1.P_A was 260 bar" in capsys.readouterr().out
    for options, wrong in (
        ([], "scope.csv: its time has no unit"),
        (["--axis", "lift"], "--axis is for --columns and --map"),
        (["--map", "CH1=P_A:bar"], "scope.csv: its time has no unit"),
        (["--map", "t=time:ms", "--map", "CH1=P_A:bar", "--axis", "lift"], "nearest is lift.P_A"),
    ):
        assert wrong in cli([*files, *options], ExitCode.USAGE).err


@pytest.mark.parametrize(
    ("unit", "words"),
    [
        (
            " [barg]",
            "in barg and one in bar makes no sense; barg is no unit here; name its unit, as",
        ),
        ("", "without a unit and one in bar makes no sense; name its unit, as --map of"),
    ],
)
def test_a_column_in_no_known_unit_is_not_judged(tmp_path, cli, unit, words):
    (tmp_path / "r.toml").write_text(PASSES)
    (tmp_path / "scope.csv").write_text(f"t [s],axis1.P_A{unit}\n0,1\n1,2\n")
    files = [str(tmp_path / "r.toml"), str(tmp_path / "scope.csv")]
    assert words in cli(["judge", *files], ExitCode.USAGE).err


@pytest.mark.parametrize(("unit", "value"), [("K", 263), ("°F", 20)])
def test_zero_of_a_temperature_needs_the_unit_of_which_it_is(tmp_path, cli, unit, value):
    """20 °F are above 0 °F and below 0 °C; a difference or another unit leaves nothing open."""
    (tmp_path / "t.csv").write_text(f"t [s],T [{unit}],U [{unit}]\n0,{value},0\n1,{value},0\n")
    file = tmp_path / "r.toml"
    words = ["judge", str(file), str(tmp_path / "t.csv")]
    for that, code in (("T < 0", 2), ("0 > previous(T)", 2), ("T < 0 °C", 0), ("T - U > 0", 0)):
        file.write_text(f'[[expect]]\nid = "R"\nthat = "always {that}"\n')
        wrong = f'T is in "{unit}" there, and is compared with a number without a unit'
        assert (wrong in cli(words, code).err) is (code == 2)


def test_rows_too_far_apart_for_a_window_decide_nothing(tmp_path, capsys):
    """At rows 100 ms apart one row alone would pass ``for 50 ms``."""
    file = tmp_path / "r.toml"
    file.write_text('[[expect]]\nid = "R"\nthat = "eventually (axis1.P_A < 250 bar for 50 ms)"\n')
    (tmp_path / "slow.csv").write_text("time [s],axis1.P_A [bar]\n0,1\n0.1,260\n0.2,260\n")

    assert main(["judge", str(file), str(tmp_path / "slow.csv")]) == ExitCode.USAGE
    wrong = "a window of 50 ms is shorter than a tick of 100 ms"
    assert f"{file}:3:21: R: {wrong}" in capsys.readouterr().err

    (tmp_path / "fast.csv").write_text("time [s],axis1.P_A [bar]\n0,1\n0.05,1\n0.1,260\n")
    assert main(["judge", str(file), str(tmp_path / "fast.csv")]) == ExitCode.DONE
