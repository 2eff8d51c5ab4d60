import json
import threading
import zlib
from pathlib import Path

import pytest
from support.tables import from_text

from device_profiles import VALVE_408
from hil_bench.abilities.common import progress
from hil_bench.abilities.conformance.check import Impact
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.suite import CHAPTERS, Outcome, Result, planned
from hil_bench.abilities.conformance.wire import SdoClient
from hil_bench.canopen_device.nmt import NmtCommand
from hil_bench.cli import main

DOCUMENT = Path(__file__).parents[3] / "docs" / "conformance.md"

EMPTY_BUS = """
[plant.axis1]
[nodes]
valve = { profile = "valve_408", node_id = 9 }
"""


def verdicts(text):
    """The rows of a report without what was found beside the verdict, such as counts of objects."""
    rows = [line.split(" | ") for line in text.splitlines() if line.startswith("| ")]
    return [row if "**FAILED**" in row else row[:4] for row in rows]


@pytest.mark.long
def test_the_published_report_is_what_its_command_writes(tmp_path, monkeypatch, capsys):
    published = DOCUMENT.read_text(encoding="utf-8")
    (command,) = [line for line in published.splitlines() if line.startswith("hil-bench ")]
    (tmp_path / "docs").mkdir()
    monkeypatch.chdir(tmp_path)
    code = main(command.split()[1:])
    written = (tmp_path / "docs" / "conformance.md").read_text(encoding="utf-8")
    # Where this fails, the command in docs/conformance.md writes it anew.
    assert verdicts(written) == verdicts(published)
    assert len(verdicts(written)) > 120
    # device_profiles/valve_408.eds; the serial number is made of the node's name.
    serial_number = f"{zlib.crc32(b'valve'):08X}h"
    assert f"product 00000408h, revision 00010000h, serial number {serial_number}" in written
    assert code == ("**FAILED**" in published)
    assert "passed" in capsys.readouterr().err


@pytest.mark.parametrize("more", [[], ["--write"]])
def test_a_report_of_the_virtual_bench_says_the_command_that_repeats_it(
    more, tmp_path, monkeypatch
):
    monkeypatch.setattr(
        "hil_bench.abilities.conformance.verbs.run_suite", lambda _dut, _allowed: iter(())
    )
    monkeypatch.chdir(tmp_path)
    words = ["conformance", "--virtual", "--node-id", "1", *more, "--report", "r.md"]
    assert main(words) == 0
    assert "hil-bench " + " ".join(words) in Path("r.md").read_text().splitlines()


@pytest.mark.parametrize("is_interrupted", [False, True])
def test_a_device_that_was_written_to_is_reset(is_interrupted, monkeypatch, capsys):
    """Its valve was in a fault otherwise, after the check of life guarding."""
    commands = []
    monkeypatch.setattr(DeviceUnderTest, "command", lambda _dut, command: commands.append(command))

    def run_suite(_dut, _allowed):
        yield from ()
        if is_interrupted:
            raise KeyboardInterrupt

    monkeypatch.setattr("hil_bench.abilities.conformance.verbs.run_suite", run_suite)
    written = ["conformance", "--virtual", "--node-id", "1", "--write"]
    assert main(written) == (130 if is_interrupted else 0)
    assert "node 1 was reset, to its power-on values\n" in capsys.readouterr().err
    assert commands == [NmtCommand.RESET_NODE]
    assert main(written[:-1]) == (130 if is_interrupted else 0)
    assert commands == [NmtCommand.RESET_NODE]


def test_reading_only_prints_a_line_a_check(cli):
    out, err = cli("conformance --virtual --node-id 4")
    assert "passed          required     7.5.2.1      1000h has the device type of the EDS" in out
    assert "7.2.8.3.3" not in out  # a reset is no reading
    assert err.endswith(" not applicable\n")


def test_json_is_for_programs(cli):
    results = json.loads(cli("conformance --virtual --node-id 2 --json").out)
    assert {result["impact"] for result in results} == {"read"}
    assert results[0]["chapter"] == "Object dictionary"


def test_the_eds_of_another_device_fails(cli, request):
    eds = request.config.rootpath / "device_profiles" / "encoder_406.eds"
    out = cli(["conformance", "--virtual", "--node-id", "2", "--eds", str(eds), "-q"], 1).out
    # The pressure transducer has device type 404 = 0x194, the encoder 406 = 0x196.
    assert "0x1000.00 is 00020194h; 00080196h by the EDS" in out
    assert "passed  " not in out


def test_what_is_wrong_in_the_eds_is_told_once(tmp_path, capsys):
    eds = tmp_path / "vendor.eds"
    text = VALVE_408.read_text(encoding="ascii")
    eds.write_text(text.replace("AccessType=const", "AccessType=co", 1), encoding="ascii")
    assert main(["conformance", "--virtual", "--node-id", "1", "--eds", str(eds)]) == 0
    told = [line for line in capsys.readouterr().err.splitlines() if str(eds) in line]
    assert len(told) == 1
    assert "warning: [1008] AccessType: is 'co'" in told[0]


def test_nobody_there_is_inconclusive_with_a_hint(make_file, capsys):
    path = make_file("bench.toml", EMPTY_BUS)
    eds = Path(__file__).parents[3] / "device_profiles" / "valve_408.eds"
    arguments = [str(path), "--virtual", "--node-id", "5", "--eds", str(eds)]
    assert main(["conformance", *arguments]) == 6
    assert "node 5 on virtual bench: 0x1000.00 cannot be read" in capsys.readouterr().err


def test_two_nodes_of_one_node_id_are_not_judged(monkeypatch, cli):
    monkeypatch.setattr(SdoClient, "answers_twice", lambda _sdo: True)
    out, err = cli("conformance --virtual --node-id 1", 1)
    assert out == ""
    assert "two answers to one SDO request: another node has this node-ID, too" in err


@pytest.mark.parametrize("more", [[], ["--json"]])
def test_a_check_that_takes_long_is_named_meanwhile(more, monkeypatch, cli):
    """Where nothing was printed for the time between two lines of progress, here none."""
    said, own = threading.Event(), progress.WorkLines.look

    def look(lines):
        own(lines)
        if lines._work.stage.startswith("1000h"):
            said.set()

    def run_suite(_dut, _allowed):
        assert said.wait(60.0)
        yield Result("Object dictionary", CHAPTERS[1].checks[0], Outcome.PASSED, "")

    monkeypatch.setattr(progress.WorkLines, "look", look)
    monkeypatch.setattr(progress, "WORK_PERIOD", 0)
    monkeypatch.setattr(progress, "_LOOK_S", 0.001)
    monkeypatch.setattr("hil_bench.abilities.conformance.verbs.run_suite", run_suite)
    monkeypatch.setattr(SdoClient, "answers_twice", lambda _sdo: False)
    err = cli(["conformance", "--virtual", "--node-id", "1", *more]).err
    count = len(planned(Impact.READ))
    line = f"conformance: 0 of {count} checks, 0 s; 1000h has the device type of the EDS"
    assert line in err


@from_text("arguments", "message")
def test_a_wrong_command_line_is_one_clear_line(arguments, message, tmp_path, monkeypatch, cli):
    monkeypatch.chdir(tmp_path)
    (line,) = cli(["conformance", "--virtual", *arguments.split()], 2).err.splitlines()
    assert message in line


@pytest.mark.parametrize("quiet", [[], ["-q"]])
def test_checks_that_are_not_run_are_one_line(quiet, monkeypatch, cli):
    """The device leaves OPERATIONAL in any check: the line counts what waits for it."""
    check = CHAPTERS[0].checks[0]
    cause = "the device leaves OPERATIONAL by EMCY 0x5000"
    results = [
        Result("NMT", check, Outcome.FAILED, cause),
        *[Result("TPDO", check, Outcome.NOT_RUN, cause)] * 21,
    ]
    monkeypatch.setattr(
        "hil_bench.abilities.conformance.verbs.run_suite", lambda _dut, _allowed: iter(results)
    )
    out, err = cli(["conformance", "--virtual", "--node-id", "1", *quiet], 1)
    failed, not_run = out.splitlines()
    assert failed.startswith("failed          required ")
    assert not_run == f"21 checks not run: {cause}"
    summary = "0 passed, 1 failed (1 required), 21 not run, 0 not applicable"
    assert (summary in err) == (not quiet)


def test_a_recommendation_is_no_reason_for_exit_code_1(monkeypatch, cli):
    result = Result("RPDO", CHAPTERS[0].checks[0], Outcome.NOT_FOLLOWED, "no EMCY")
    monkeypatch.setattr(
        "hil_bench.abilities.conformance.verbs.run_suite", lambda _dut, _allowed: iter([result])
    )
    assert "not followed    required" in cli("conformance --virtual --node-id 1").out
