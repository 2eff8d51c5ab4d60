"""Scenario files as tests of pytest: an item a requirement, with properties for JUnit."""

import xml.etree.ElementTree as ET

import pytest

from hil_bench.abilities.scenario import results
from hil_bench.abilities.scenario.pytest_items import RequirementOutcome, played_once
from hil_bench.abilities.scenario.results import ScenarioResult
from hil_bench.errors import ControllerError

pytest_plugins = ["pytester"]

HEAD = 'title = "T"\nduration_s = 0.02\n'


def write(pytester, *texts, head=HEAD):
    expects = (f"[[expect]]\nid = \"R{k}\"\nthat = '{that}'\n" for k, that in enumerate(texts))
    (pytester.path / "a.scenario.toml").write_text(head + "".join(expects))


HOLDS, FAILS = "always axis1.P_A < 250 bar", "always axis1.P_A < 1 bar"
ASLEEP_OUTCOME = RequirementOutcome.NOT_EXERCISED
ASLEEP = "whenever axis1.P_A > 250 bar then axis1.P_B > 1 bar"


def test_each_requirement_is_a_test(pytester):
    write(pytester, HOLDS, FAILS, ASLEEP)
    result = pytester.runpytest_inprocess("--junitxml=junit.xml")
    result.assert_outcomes(passed=1, failed=2)
    result.stdout.fnmatch_lines(
        [
            "R1: always axis1.P_A < 1 bar",
            "failed: first violated at 0 s*; seen * of * s",
            f"{ASLEEP_OUTCOME}: *",
        ]
    )
    cases = list(ET.parse(pytester.path / "junit.xml").iter("testcase"))  # noqa: S314 - our own
    assert [case.get("name") for case in cases] == ["R0", "R1", "R2"]
    properties = {each.get("name"): each.get("value") for each in cases[0].iter("property")}
    assert properties["requirement_id"] == "R0"
    assert float(properties["margin"]) > 0.0
    assert properties["seen"] == "1"


def test_what_is_named_and_not_judged_fails(pytester):
    write(pytester, HOLDS, head=HEAD + 'requirement_ids = ["R0", "SRS-9"]\n')
    result = pytester.runpytest_inprocess("--junitxml=junit.xml")
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["SRS-9: requirement_ids names it, and no expectation has *"])
    junit = (pytester.path / "junit.xml").read_text()
    assert '<property name="requirement_id" value="SRS-9"' in junit


def test_a_run_that_broke_off_names_its_requirements(pytester, monkeypatch):
    def play(*_):
        raise ControllerError("it died")

    monkeypatch.setattr(results, "play", play)
    write(pytester, HOLDS, FAILS)
    pytester.runpytest_inprocess("--junitxml=junit.xml").assert_outcomes(failed=2)
    found = ET.parse(pytester.path / "junit.xml").iter("property")  # noqa: S314 - our own
    assert [(each.get("name"), each.get("value")) for each in found] == [
        ("requirement_id", "R0"),
        ("requirement_id", "R1"),
    ]


COUNTING = """
import pathlib
from hil_bench.abilities.scenario import results

real = results.play

def play(prepared, options):
    with pathlib.Path({log!r}).open("a") as file:
        file.write(prepared.scenario.path.name + "\\n")
    return real(prepared, options)

results.play = play
"""


@pytest.mark.long  # processes start
@pytest.mark.parametrize("dist", ["load", "each", "worksteal"])
def test_workers_play_a_scenario_once_between_them(pytester, dist):
    pytest.importorskip("xdist")
    log = pytester.path / "plays.txt"
    pytester.makeconftest(COUNTING.format(log=str(log)))
    write(pytester, *[HOLDS] * 5, FAILS)
    (pytester.path / "b.scenario.toml").write_text((pytester.path / "a.scenario.toml").read_text())
    each = 2 if dist == "each" else 1
    result = pytester.runpytest_subprocess("-n", "2", "--dist", dist, "--junitxml=junit.xml")
    result.assert_outcomes(passed=10 * each, failed=2 * each)
    assert sorted(log.read_text().split()) == ["a.scenario.toml", "b.scenario.toml"]
    cases = list(ET.parse(pytester.path / "junit.xml").iter("testcase"))  # noqa: S314 - our own
    assert len(cases) == 12 * each
    assert all(case.find("properties") is not None for case in cases)


class Worker:
    """What `played_once` needs of a worker's `pytest.Config`."""

    def __init__(self, folder, run):
        folder.mkdir(exist_ok=True)
        self.workerinput = {"testrunuid": run}
        self._tmp_path_factory = self
        self.getbasetemp = lambda: folder


def test_a_worker_takes_what_another_one_of_its_run_has_played(tmp_path):
    path = tmp_path / "a.scenario.toml"
    result = ScenarioResult(str(path), "T", (), 0, {})
    plays = []

    def play(found=result):
        plays.append(found)
        if found is None:
            raise ControllerError("gone")
        return found

    workers = [Worker(tmp_path / name, "1") for name in ("gw0", "gw1")]
    with pytest.raises(ControllerError):  # of no whole run nothing is kept
        played_once(workers[0], path, lambda: play(None))
    assert [played_once(worker, path, play) for worker in workers] == [result, result]
    assert plays == [None, result]
    played_once(Worker(tmp_path / "gw0", "2"), path, play)
    played_once(workers[0], tmp_path / "b.scenario.toml", play)
    assert len(plays) == 4


def test_k_chooses_a_requirement(pytester):
    write(pytester, HOLDS, FAILS)
    pytester.runpytest_inprocess("-k", "R0").assert_outcomes(passed=1, deselected=1)


@pytest.mark.parametrize(
    ("text", "head", "wrong"),
    [
        (HOLDS, 'title = "T"\n', "*a.scenario.toml: duration_s*"),
        ("always axis1.P_a < 1 bar", HEAD, '*R0: "axis1.P_a" is no signal here; the nearest is*'),
    ],
)
def test_a_wrong_file_is_told_in_a_line(pytester, text, head, wrong):
    write(pytester, text, head=head)
    result = pytester.runpytest_inprocess()
    assert result.ret != pytest.ExitCode.OK
    result.stdout.fnmatch_lines([wrong])
    result.stdout.no_fnmatch_line("*Traceback*")


def test_a_physical_bench_skips_scenarios(pytester):
    write(pytester, HOLDS)
    arguments = ["--hil-interface=virtual", "--hil-channel=none"]
    pytester.runpytest_inprocess(*arguments).assert_outcomes(skipped=1)
