import json
import re

import pytest

from hil_bench.abilities.doctor.machine import Finding, Topic, Verdict
from hil_bench.abilities.doctor.verbs import report_lines
from hil_bench.outside.realtime.clock import VirtualClock

TOPICS = [
    Topic("One", (Finding("a", Verdict.GOOD, "fine"), Finding("long", Verdict.HINT, "so", "more"))),
    Topic("Two", (Finding("b", Verdict.ABSENT, "none"), Finding("c", Verdict.MISSING, "no"))),
]


@pytest.fixture(autouse=True)
def _virtual_time(monkeypatch):
    monkeypatch.setattr("hil_bench.abilities.doctor.verbs.MonotonicClock", VirtualClock)


def test_each_finding_is_a_line_and_each_advice_one_below():
    lines = list(report_lines(TOPICS, [], is_coloured=False))
    assert lines[1:] == [
        "",
        "One",
        "  ok    a     fine",
        "  hint  long  so",
        "              -> more",
        "",
        "Two",
        "  -     b     none",
        "  no    c     no",
    ]


def test_colours_are_for_terminals():
    plain = "\n".join(report_lines(TOPICS, [], is_coloured=False))
    coloured = "\n".join(report_lines(TOPICS, [], is_coloured=True))
    assert "\x1b" not in plain
    assert "\x1b[32mok  \x1b[0m" in coloured


def test_it_looks_at_this_machine_and_measures(cli):
    out = cli("doctor --seconds 0.3").out
    for name in ("Permissions", "Machine", "CAN", "Software", "Lateness at 1 kHz, "):
        assert f"\n{name}" in out
    assert "\n  run " in out


def test_a_program_can_read_it(cli):
    answer = json.loads(cli("doctor --json --seconds 0.05").out)
    found = {item["name"]: item for item in answer["findings"]}
    assert found["SocketCAN"]["topic"] == "CAN"
    assert {item["verdict"] for item in found.values()} <= {"good", "hint", "missing", "absent"}
    # A clock that jumps is never late.
    assert answer["lateness"][0]["lateness"]["max_us"] == 0


def test_without_a_test_nothing_is_measured(cli):
    assert json.loads(cli("doctor --json --seconds 0").out)["lateness"] == []


def test_what_it_says_of_the_kernels_is_of_a_bench_that_was_built(monkeypatch, cli):
    built = []
    monkeypatch.setattr("hil_bench.abilities.doctor.verbs.build_bench", built.append)
    cli("doctor --seconds 0")
    assert len(built) == 1


def test_a_long_measurement_is_announced(monkeypatch, cli):
    monkeypatch.setattr("hil_bench.abilities.doctor.verbs._LONG", 0.05)
    assert cli("doctor --seconds 0.04").err == ""
    assert cli("doctor --seconds 0.05").err == "hil-bench: the lateness is measured for 0.05 s\n"


def test_other_systems_get_a_report_too(monkeypatch, cli):
    for module in ("machine", "verbs"):
        monkeypatch.setattr(f"hil_bench.abilities.doctor.{module}.IS_LINUX", False)
    assert re.search(r"SCHED_FIFO +Linux only", cli("doctor --seconds 0.01").out)


@pytest.mark.parametrize("seconds", ["-1", "nan", "4000"])
def test_a_length_that_cannot_be_meant(seconds, cli):
    assert "give 0 to 3600 s" in cli(["doctor", "--seconds", seconds], 2).err
