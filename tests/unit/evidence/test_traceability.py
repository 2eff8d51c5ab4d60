"""From requirement to test to result, and files that are no results."""

import json

import pytest
from support.tables import from_text

from hil_bench.abilities.evidence.content import read_results, trace
from hil_bench.abilities.scenario.results import ScenarioResult, write_junit
from hil_bench.errors import ConfigError

JUNIT = """<?xml version="1.0"?>
<testsuites><testsuite name="s">
<testcase classname="a" name="one"><properties>
<property name="requirement_id" value="SRS-1"/></properties></testcase>
<testcase classname="a" name="two"><properties>
<property name="requirement_id" value="SRS-1"/>
<property name="requirement_id" value="SRS-4"/></properties><failure message="too slow"/></testcase>
<testcase classname="a" name="three"><properties>
<property name="requirement_id" value="SRS-2"/>
<property name="outcome" value="passed"/></properties><skipped message="no bus"/></testcase>
<testcase classname="a" name="four"><properties>
<property name="requirement_id" value="SRS-3"/></properties>
<failure type="inconclusive" message="the signal is unknown"/></testcase>
<testcase classname="a" name="free"/>
</testsuite></testsuites>
"""


def judged(requirement, outcome):
    judgement = {"outcome": outcome, "deciding": None, "reason": "why"}
    text = "nothing seen after 1 s"
    return {"id": requirement, "that": "always x > 0", "judgement": judgement, "text": text}


def scenario(*findings, problem="", declared=()):
    return {"requirement_ids": list(declared), "problem": problem, "findings": list(findings)}


@pytest.fixture
def traced(tmp_path):
    def read(**contents):
        paths = []
        for name, content in contents.items():
            path = tmp_path / name
            text = content if isinstance(content, str) else json.dumps(content)
            path.write_text(text, encoding="utf-8")
            paths.append(path)
        return trace(read_results(paths))

    return read


def outcomes(found):
    return {row["requirement"]: row["outcome"] for row in found["requirements"]}


def test_the_worst_result_of_a_requirement_counts(traced):
    found = traced(
        first={"a": scenario(judged("R-1", "passed"), judged("R-2", "inconclusive"))},
        second={"b": scenario(judged("R-1", "failed"), judged("R-2", "passed"))},
    )
    assert outcomes(found) == {"R-1": "failed", "R-2": "inconclusive"}
    tests = found["requirements"][0]["tests"]
    assert [test["test"] for test in tests] == ["a", "b"]
    assert {test["reason"] for test in tests} == {"nothing seen after 1 s"}
    assert found["verdict"] == "failed"


def test_a_requirement_that_a_scenario_names_and_does_not_judge_is_seen(traced):
    found = traced(
        results={
            "a": scenario(judged("R-1", "passed"), declared=["R-1", "R-2"]),
            "b": scenario(problem="the firmware did not start", declared=["R-3"]),
            "c": scenario(problem="no bus"),
        }
    )
    assert outcomes(found) == {"R-1": "passed", "R-2": "not exercised", "R-3": "failed"}
    assert [test["reason"] for test in found["without_requirement"]] == ["no bus"]


def test_junit_by_property(traced):
    found = traced(junit=JUNIT)
    assert outcomes(found) == {
        "SRS-1": "failed",
        "SRS-4": "failed",
        "SRS-2": "not exercised",
        "SRS-3": "inconclusive",
    }
    assert [row["test"] for row in found["without_requirement"]] == ["a::free"]


@pytest.mark.parametrize(("problem", "outcome"), [("no SYNC", "failed"), ("", "not exercised")])
def test_what_a_scenario_does_not_judge_is_the_same_by_json_and_junit(
    traced, tmp_path, problem, outcome
):
    declared = "R-1", "R-2"
    write_junit([ScenarioResult("a", "T", declared, 0, {}, problem=problem)], tmp_path / "j.xml")
    by_junit = trace(read_results([tmp_path / "j.xml"]))
    by_json = traced(json={"a": scenario(problem=problem, declared=declared)})
    assert outcomes(by_junit) == outcomes(by_json) == dict.fromkeys(declared, outcome)
    assert by_junit["verdict"] == by_json["verdict"] == outcome


def test_an_outcome_that_nobody_knows_is_a_failure(traced):
    assert outcomes(traced(a={"a": scenario(judged("R-1", "splendid"))})) == {"R-1": "failed"}


def test_without_results_there_is_no_verdict():
    assert trace([])["verdict"] == "not applicable"


def test_a_scenario_has_its_digest(traced, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.scenario.toml").write_bytes(b"{}")
    found = traced(a={"x.scenario.toml": scenario(judged("R", "passed")), "/dev/zero": scenario()})
    # printf '{}' | sha256sum
    digest = "44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a"
    assert found["scenarios"] == [{"file": "x.scenario.toml", "sha256": digest}]


ENTITIES = '<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><testsuites>&b;</testsuites>'


@pytest.mark.parametrize(
    "text",
    [
        "",
        "nothing",
        "[]",
        "3",
        '{"a": 1}',
        '{"a": {}}',
        '{"a": {"findings": 1, "problem": "", "requirement_ids": []}}',
        '{"a": {"findings": [1], "problem": "", "requirement_ids": []}}',
        "[" * 100_000,
        "<html/>",
        "<testsuites>",
        '<?xml version="1.0" encoding="klingon"?><testsuites/>',
        ENTITIES,
    ],
)
def test_a_file_that_holds_no_results_is_refused_in_one_line(traced, text):
    with pytest.raises(ConfigError) as refused:
        traced(wrong=text)
    assert "--results" in str(refused.value)
    assert "hil-bench test --json" in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


@from_text("counts", "wrong")
def test_a_file_that_counts_more_than_its_cases_is_refused(traced, counts, wrong):
    text = JUNIT.replace('name="s"', f'name="s" {counts}')
    if not wrong:
        assert outcomes(traced(junit=text))["SRS-1"] == "failed"
        return
    with pytest.raises(ConfigError) as refused:
        traced(junit=text)
    assert wrong in str(refused.value).replace('"', "'")


def test_a_run_that_broke_off_is_failed_whatever_it_found(traced):
    found = traced(a={"a": scenario(judged("R-1", "passed"), problem="it hung", declared=["R-1"])})
    assert found["verdict"] == "failed"


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="No such file"):
        read_results([tmp_path / "none.json"])


def test_a_file_that_is_too_large_is_not_read(make_file, monkeypatch):
    monkeypatch.setattr("hil_bench.abilities.evidence.content.MOST_BYTES", 3)
    (file,) = read_results([make_file("most", b"123")])
    assert file.content == b"123"
    with pytest.raises(ConfigError, match="larger than"):
        read_results([make_file("more", b"1234")])
