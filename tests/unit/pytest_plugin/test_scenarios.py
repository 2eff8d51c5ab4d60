"""Scenario files as tests of pytest: an item a requirement, with properties for JUnit."""

import xml.etree.ElementTree as ET

import pytest

from hil_bench.pytest_plugin.scenarios import RequirementOutcome

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
