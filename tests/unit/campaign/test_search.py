"""The search, on scenarios whose margins have a closed form."""

import json
import shutil
import subprocess
import sys
from contextlib import nullcontext

import numpy as np
import pytest
from support.campaigns import REST, margin_of, rest_pressures, run_result, write_rest
from support.tables import from_text

from hil_bench import ConfigError
from hil_bench.abilities.campaign.falsify import KeptRuns, SearchPlan, falsify
from hil_bench.abilities.campaign.plan import make_spec, own_case
from hil_bench.abilities.campaign.records import Verdict
from hil_bench.abilities.campaign.search import (
    ALL_METHODS,
    Budget,
    Evolution,
    Method,
    SearchResult,
    Trial,
    build_search,
)
from hil_bench.abilities.campaign.shrink import Target, round_to, shrink
from hil_bench.abilities.campaign.snapshot import perform_here
from hil_bench.abilities.campaign.summary import tally_of
from hil_bench.abilities.campaign.verbs.falsify import exit_code_of_search
from hil_bench.abilities.scenario.judgement import RequirementOutcome
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.run import play, prepare
from hil_bench.cli import main
from hil_bench.cli.exit_codes import ExitCode

REST_SPACE = {"limit_bar": None, "load_n": None}

# A tenth of the range fails, and one step and one requirement have nothing to do with it.
P_A = rest_pressures()[0]
NARROW = REST.replace("range = [1.0, 301.0]", f"range = [{P_A - 25:.3f}, {P_A + 225:.3f}]")


def search(path, folder, runs=40, methods=ALL_METHODS):
    plan = SearchPlan(methods, Budget(runs), seed=1)
    return falsify(path, plan, perform_here, folder, lambda _result: None)


def made_up(*margins):
    """Return a result with a verdict a margin: R-0, R-1, ..."""
    return run_result(
        *(
            Verdict(f"R-{place}", "failed" if margin < 0 else "passed", margin, "")
            for place, margin in enumerate(margins)
        ),
        outcome="passed",
    )


@pytest.mark.long  # tens of runs of a scenario
def test_a_failure_is_found_made_small_and_fails_again(tmp_path):
    path = write_rest(tmp_path, NARROW)
    found = search(path, tmp_path / "out", methods=(Method.CMA_ES,))
    (failure,) = found.failures
    assert failure.target.requirement == "R-1"
    small = load_scenario(failure.files.scenario)
    # The only thing that matters is the limit: the load, its step and R-2 are gone.
    assert [each.name for each in small.parameters] == ["limit_bar"]
    assert small.steps == ()
    assert [each.id for each in small.expectations] == ["R-1"]
    assert small.duration < 0.01
    # A limit below the pressure at rest, brought near to the usual 250 bar and rounded.
    limit = small.parameters[0].value
    assert P_A - 25 < limit < P_A
    assert round_to(limit, 2) == limit
    judgements = [play(prepare(small)).findings[0].judgement for _ in range(2)]
    assert repr(judgements[0]) == repr(judgements[1])
    assert judgements[0].margin == failure.shrunk.result.verdicts[0].margin


FIXED = REST.replace("load_n = { value = 0.0, range = [-1.0, 1.0] }", "load_n = 0.1234").replace(
    "at_s = 0.01\n", "at_s = 0.0025\n"
)


@pytest.mark.parametrize(
    ("that", "duration", "steps"),
    [
        ("always axis1.P_A < limit_bar", 0.0013, 0),  # its violation is seen at once
        ("always after 3 ms axis1.P_A < limit_bar", 0.0039, 1),  # needs 3 ms, and the step before
        ("eventually axis1.P_A > limit_bar", 0.01, 1),  # a shorter run might not come to it
    ],
)
def test_what_the_author_fixed_stays_when_a_failure_is_made_small(tmp_path, that, duration, steps):
    text = FIXED.replace("always axis1.P_A < limit_bar", that)
    scenario = load_scenario(write_rest(tmp_path, text))
    played = []

    def fails(candidate):
        played.append(candidate)
        prepare(candidate)  # refuses one that is too short
        limit = next(each.value for each in candidate.parameters if each.name == "limit_bar")
        return run_result(Verdict("R-1", "failed" if limit < 47.11 else "passed", None, ""))

    trial = Trial(Method.RANDOM, 1, {"limit_bar": 12.345678}, fails(scenario))
    small = shrink(scenario, trial, Target("R-1"), fails)
    assert small.scenario.duration == pytest.approx(duration, rel=0.3)
    assert small.scenario.steps == scenario.steps[:steps]
    found = {each.name: each.value for each in small.scenario.parameters}
    assert 46.0 <= found["limit_bar"] <= 47.0  # near to the file's 250, two digits
    assert found.get("load_n", 0.1234) == 0.1234
    for each in played:
        values = {one.name: one.value for one in each.parameters}
        assert 1.0 <= values["limit_bar"] <= 301.0
        assert values.get("load_n", 0.1234) == 0.1234
        assert {*each.steps} <= {*scenario.steps}


def test_a_parameter_of_another_requirement_alone_is_left_out(tmp_path):
    other = '[[expect]]\nid = "R-9"\nthat = "always axis1.P_B < other_bar"\n'
    text = FIXED.replace("[parameters]\n", "[parameters]\nother_bar = 200.0\n") + other
    scenario = load_scenario(write_rest(tmp_path, text))

    def fails(_candidate):
        return run_result(Verdict("R-1", "failed", None, ""))

    trial = Trial(Method.RANDOM, 1, {"limit_bar": 12.0}, fails(scenario))
    small = shrink(scenario, trial, Target("R-1"), fails)
    assert "other_bar" not in {each.name for each in small.scenario.parameters}


@pytest.mark.parametrize(
    ("low", "high", "short"),
    [
        # Of 165.6 the two digits 170 do not fail, and their neighbour 160 does.
        (156.4, 165.65, 160.0),
        (0.5, 40.9, 40.0),
    ],
)
def test_a_number_of_a_small_failure_has_few_digits(tmp_path, low, high, short):
    """Brought near to the file's 250 it ends at the upper limit; then digits are left out."""
    scenario = load_scenario(write_rest(tmp_path, FIXED))

    def fails(candidate):
        limit = next(each.value for each in candidate.parameters if each.name == "limit_bar")
        outcome = "failed" if low <= limit < high else "passed"
        return run_result(Verdict("R-1", outcome, None, ""))

    trial = Trial(Method.RANDOM, 1, {"limit_bar": 0.5 * (low + high)}, fails(scenario))
    small = shrink(scenario, trial, Target("R-1"), fails)
    assert next(e.value for e in small.scenario.parameters if e.name == "limit_bar") == short


def test_a_failure_that_fails_otherwise_when_played_again_is_said(tmp_path):
    seen = set()

    def drifting(specs):
        for result in perform_here(specs):
            twice = result.key in seen
            seen.add(result.key)
            moved = tuple(each._replace(margin=-0.5) for each in result.verdicts)
            yield result._replace(verdicts=moved) if twice else result

    with pytest.raises(ConfigError, match=r"does not fail as it did; is the controller random\?$"):
        falsify_here(write_rest(tmp_path, WIDE), tmp_path / "out", drifting)


@pytest.mark.long  # tens of runs of a scenario
def test_the_points_of_a_course_are_searched(tmp_path):
    (tmp_path / "load.csv").write_text("0,0\n0.004,peak_n\n0.008,0\n")
    course = """\
title = "Load"
duration_s = 0.02
[parameters]
peak_n = { value = 0.0, range = [-60000.0, 60000.0] }
[[step]]
at_s = 0.001
set = "axis1.load"
table = "load.csv"
[[expect]]
id = "R-1"
that = "always axis1.P_A < 55 bar"
"""
    found = search(write_rest(tmp_path, course), tmp_path / "failures", 16, (Method.SOBOL,))
    (failure,) = found.failures
    # At rest P_A is 48.5 bar: without a load the requirement holds.
    assert abs(failure.shrunk.scenario.parameters[0].value) > 100.0
    assert 'table = "../load.csv"' in failure.files.scenario.read_text()


def test_a_written_failure_finds_the_files_of_its_controller(tmp_path):
    (tmp_path / "mine.py").write_text("def idle(rig):\n    rig.sleep(1e6)\n")
    controller = '[controller]\nkind = "python"\ncall = "mine.py:idle"\n[parameters]\n'
    text = NARROW.replace("[parameters]\n", controller)
    found = search(write_rest(tmp_path, text), tmp_path / "failures", 16, (Method.SOBOL,))
    small = load_scenario(found.failures[0].files.scenario)
    assert small.path.parent == tmp_path / "failures"
    assert {each.judgement.outcome for each in play(prepare(small)).findings} == {
        RequirementOutcome.FAILED
    }


@pytest.mark.long  # tens of runs of a scenario
def test_the_written_test_fails_under_pytest(tmp_path):
    found = search(write_rest(tmp_path, NARROW), tmp_path / "out", methods=(Method.CMA_ES,))
    lines = found.failures[0].files.test.read_text().splitlines()
    assert len([line for line in lines if line]) <= 10
    alone = tmp_path / "alone"
    alone.mkdir()
    for each in found.failures[0].files:
        shutil.copy(each, alone)
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_rest_r_1.py"]
    ended = subprocess.run(words, cwd=alone, capture_output=True, text=True, check=False)  # noqa: S603
    assert ended.returncode == 1, ended.stdout
    assert "margin=-" in ended.stdout


@pytest.mark.long  # tens of runs of a scenario
def test_no_failure_ends_with_a_bound_and_never_with_correct(tmp_path):
    path = write_rest(tmp_path, REST.replace("range = [1.0", "range = [60.0"))
    found = search(path, tmp_path / "out", runs=20)
    assert found.failures == ()
    text = "\n".join(found.lines())
    assert "R-1: no failure in 60 runs; smallest margin at limit_bar=6" in text
    # 1 - 0.05^(1/20) = 0.139
    assert "95% upper bound on the failure probability under the sampled distribution 0.14" in text
    assert "correct" not in text


@pytest.mark.long  # tens of runs of a scenario
def test_the_same_seed_finds_the_same(tmp_path):
    path = write_rest(tmp_path, NARROW)
    first, second = (search(path, tmp_path / name, runs=20).search for name in "ab")
    assert [each.point for each in first.trials] == [each.point for each in second.trials]
    assert len(first.trials) == 60


def test_evolution_comes_to_the_corner_that_random_misses():
    # The margin is the distance from a corner of the cube, a ball of 3 % of a width around fails:
    # of random points a share of 4/3 π 0.03³ / 8 = 1.4e-5 hits it.
    def margin(points):
        return np.linalg.norm(points, axis=1) - 0.03

    def smallest(method):
        found = build_search(method, ["R-0"], 3, 300, seed=5)
        best, done = np.inf, 0
        while done < 300:
            points = found.ask()[: 300 - done]
            margins = margin(points)
            found.tell(points, [made_up(each) for each in margins])
            best, done = min(best, margins.min()), done + len(points)
        return best

    assert smallest(Method.CMA_ES) < 0 < smallest(Method.RANDOM)


def test_no_requirement_starves():
    # R-0 has a small margin that never fails; R-1 fails in a corner, and its margins are large.
    search = Evolution(["R-0", "R-1"], 2, seed=1)
    found = []
    for _ in range(60):
        points = search.ask()
        far = np.linalg.norm(points - 1.0, axis=1)
        search.tell(points, [made_up(0.01, 3.0 * each - 0.1) for each in far])
        found += [each for each in far if 3.0 * each < 0.1]
    assert found


def test_evolution_starts_at_the_best_point_that_is_known():
    search = Evolution(["R-0"], 2, seed=3)
    first = search.ask()
    far = np.linalg.norm(first - 1.0, axis=1)
    search.tell(first, [made_up(each) for each in far])
    # Points spread by 0.3 a side about the best of 16, which is the nearest to the corner.
    second = search.ask()
    best, worst = first[np.argmin(far)], first[np.argmax(far)]
    middle = second.mean(axis=0)
    assert np.linalg.norm(middle - best) < 0.3 < np.linalg.norm(middle - worst)


@pytest.mark.parametrize(("spread", "generations"), [(0.1, 13), (0.0, 4)])
def test_evolution_starts_anew_where_nothing_becomes_smaller(spread, generations):
    """12 generations behind the first, which is the best; without a difference each counts four."""
    search = Evolution(["R-0"], 2, seed=3)
    search.tell(search.ask(), [made_up(0.5)] * 16)
    done = 0
    while not search._starts:
        points = search.ask()
        margins = [0.5 + spread * (number % 2) for number in range(len(points))]
        search.tell(points, [made_up(each) for each in margins])
        done += 1
    assert done == generations


def test_a_scenario_without_ranges_cannot_be_searched(tmp_path, capsys):
    plain = REST.replace(", range = [1.0, 301.0]", "").replace(", range = [-1.0, 1.0]", "")
    path = write_rest(tmp_path, plain)
    assert main(["falsify", str(path), "--jobs=0"]) == 2
    assert "no parameter has a range; give one, as in" in capsys.readouterr().err


def test_a_run_that_decides_nothing_keeps_a_search_from_passing(tmp_path, monkeypatch):
    """P_A is 48 bar at rest: a bound above it is never met, and one below it holds."""
    monkeypatch.chdir(tmp_path)
    rule = "whenever axis1.P_A > limit_bar then axis1.P_A < 200 bar"
    text = REST.replace("always axis1.P_A < limit_bar", "always axis1.P_A < 200 bar")
    text = text.replace("always axis1.P_B < 200 bar", rule)
    text = text.replace("value = 250.0, range = [1.0, 301.0]", "value = 50.0, range = [1.0, 99.0]")
    path = write_rest(tmp_path, text)
    found = falsify_here(path, tmp_path / "out", perform_here)
    tally = next(each.tally for each in found.search.finds if each.id == "R-2")
    assert tally.passed
    assert tally.undecided
    assert main(["falsify", str(path), "--jobs=0", "--runs=6", "--seed=1"]) == 6


@pytest.mark.parametrize(
    ("never", "outcome"),
    [
        ("whenever axis1.P_B > 500 bar then axis1.P_A < 1 bar", "not exercised"),
        ("always (axis1.P_B < 200 bar for 5 ms)", "inconclusive"),  # the last ticks are open
    ],
)
def test_a_requirement_that_no_run_decided_is_said(never, outcome, tmp_path, cli, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = REST.replace("always axis1.P_B < 200 bar", never)
    path = write_rest(tmp_path, text.replace("range = [1.0", "range = [60.0"))
    out = cli(["falsify", str(path), "--jobs=0", "--runs=2", "--method=random"], 6).out
    assert f"R-2: was never decided: 0 decided runs of 2 (2 {outcome}); nothing is known" in out
    # 1 - 0.05^(1/2) = 0.776
    assert "under the sampled distribution 0.78 (2 random runs)" in out
    words = ["falsify", str(path), "--jobs=0", "--runs=2", "--method=random", "--json"]
    found = json.loads(cli(words, 6).out)
    assert (found["runs"], found["failures"], found["is_interrupted"]) == ({"random": 2}, [], False)
    one, two = found["requirements"]
    keys = ("id", "is_failed", "is_exercised", "undecided_runs")
    assert [one[key] for key in keys] == ["R-1", False, True, {}]
    assert [two[key] for key in keys] == ["R-2", False, False, {outcome: 2}]
    assert one["smallest_margin"] == pytest.approx(margin_of(one["at"]["limit_bar"]))


def test_a_run_that_crashed_is_no_run_without_failure():
    passed = run_result(Verdict("R-1", "passed", 0.5, "holds"))
    crashed = run_result(outcome="crashed", problem="gone")
    tally = tally_of("R-1", [passed, crashed, crashed])
    assert tally.failures_text() == "no failure in 1 decided runs of 3 (2 crashed)"
    # 1 - 0.05: one run bounds it, three would say 0.63
    assert tally.bound_text().endswith("of decided runs under the sampled distribution 0.95")


@pytest.mark.long  # tens of runs of a scenario
def test_the_command_line_says_where_the_failure_stands(tmp_path, capsys, cli, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = write_rest(tmp_path, NARROW)
    assert main(["falsify", str(path), "--jobs=0", "--runs=20", "--method=cma-es"]) == 1
    repeat = capsys.readouterr().out.rpartition("repeat it: ")[2]
    assert "R-1  failed" in cli(repeat.split()[1:], 1).out


class Interrupted:
    """Does some runs, and then somebody presses Ctrl-C."""

    def __init__(self, runs):
        self.left = runs

    def __call__(self, specs):
        for spec in specs:
            if not self.left:
                raise KeyboardInterrupt
            self.left -= 1
            yield perform_here([spec]).__next__()


# P_A is 48 bar at rest: all runs fail.
WIDE = REST.replace("value = 250.0, range = [1.0, 301.0]", "value = 30.0, range = [1.0, 40.0]")


def falsify_here(path, folder, backend, runs=6):
    plan = SearchPlan((Method.RANDOM, Method.SOBOL), Budget(runs), seed=1)
    return falsify(path, plan, backend, folder, lambda _result: None)


def test_an_interrupted_search_says_what_it_found_and_goes_on(tmp_path):
    path, out = write_rest(tmp_path, WIDE), tmp_path / "out"
    first = falsify_here(path, out, Interrupted(9))
    assert first.is_interrupted
    numbers = [(each.method, each.number) for each in first.search.trials]
    assert numbers[6:] == [(Method.SOBOL, each) for each in (1, 2, 3)]
    (failure,) = first.failures
    assert failure.shrunk.is_interrupted
    assert load_scenario(failure.files.scenario).duration == load_scenario(path).duration
    assert "R-1: shrunk in 0 runs to 0.01 s, 1 steps, and interrupted" in "\n".join(first.lines())
    # The other three of sobol's are to be done, and the shrinking, which is interrupted.
    second = falsify_here(path, out, Interrupted(5))
    assert second.is_interrupted
    assert len(second.search.trials) == 12
    assert second.failures[0].shrunk.runs == 2
    whole = falsify_here(path, out, perform_here)
    fresh = falsify_here(path, tmp_path / "other", perform_here)
    assert (whole.search, whole.is_interrupted) == (fresh.search, False)
    assert whole.failures[0].shrunk == fresh.failures[0].shrunk
    names = sorted(each.name for each in out.iterdir())
    assert names == ["rest_r_1.scenario.toml", "test_rest_r_1.py"]


def test_a_failure_that_cannot_be_written_is_said_all_the_same(tmp_path, capsys):
    path = write_rest(tmp_path, WIDE)
    (tmp_path / "out").write_text("a file, where a folder should be")
    words = ["falsify", str(path), "--jobs=0", "--runs=2", "--method=random"]
    assert main([*words, f"--output={tmp_path / 'out'}"]) == 1
    said = capsys.readouterr()
    assert "R-1: fails at" in said.out
    assert f"not written: {tmp_path / 'out'}" in said.out
    assert "interrupted" not in said.err


def test_the_command_line_says_how_to_go_on(tmp_path, capsys, cli, monkeypatch):
    monkeypatch.setattr(
        "hil_bench.abilities.campaign.verbs.falsify.local_backend",
        lambda _: nullcontext(Interrupted(2)),
    )
    path = write_rest(tmp_path, WIDE)
    words = ["falsify", str(path), "--runs=2", f"--output={tmp_path / 'out'}"]
    assert main(words) == 1  # a failure was found, whatever came then
    said = capsys.readouterr()
    assert "interrupted after 2 of 6 runs; the same command goes on from there" in said.err
    assert "R-1: fails at" in said.out
    monkeypatch.setattr("hil_bench.abilities.campaign.falsify.Store.write", refuse)
    said = cli([*words, "--seed=3"], 1)
    assert "interrupted after 2 of 6 runs; out: cannot be written: No space left" in said.err
    assert "R-1: fails at" in said.out


def refuse(_self, _results):
    raise ConfigError("out: cannot be written: No space left")


def test_a_run_that_came_twice_is_kept_once(tmp_path):
    case = own_case(load_scenario(write_rest(tmp_path)))
    # The values of the file, once as a point of the search and once as a failure made usual again.
    spec = make_spec(case, {"limit_bar": 250.0, "load_n": 0.0}, REST_SPACE, None, 60.0)
    usual = make_spec(case, {}, {}, None, 60.0)
    assert spec.key == usual.key
    kept = KeptRuns(perform_here, tmp_path, case)
    for each in (spec, usual):
        assert len(list(kept([each]))) == 1
    assert kept.keep() == ""
    again = KeptRuns(Interrupted(0), tmp_path, case)
    assert [each.key for each in again([spec])] == [spec.key]


@from_text("words", "right")
def test_a_number_that_makes_no_sense_is_refused_at_once(words, right, cli):
    verb, *rest = words.split()
    assert right in cli([verb, "rest.scenario.toml", *rest], 2).err


def test_a_search_without_a_requirement_decides_nothing():
    """docs/exit-codes.md: 6 where what was to be checked was not seen."""
    nothing = SearchResult((), (), is_interrupted=False)
    assert exit_code_of_search(nothing) is ExitCode.INCONCLUSIVE
