"""One cause is one failure: its consequences are not run, and what a clause leaves open passes."""

import pytest
from support.changed_frames import LSS, REQUEST, aborted_otherwise, begun_otherwise, lost

from hil_bench.abilities.conformance import report
from hil_bench.abilities.conformance.check import Degree, Impact
from hil_bench.abilities.conformance.device import find_fall
from hil_bench.abilities.conformance.suite import CHAPTERS, Outcome
from hil_bench.canopen_device.frame import Frame

START, ENTER_PRE_OPERATIONAL = Frame(0x000, b"\x01\x05"), Frame(0x000, b"\x80\x05")
OPERATIONAL = Frame(0x705, b"\x05")
# Generic error with a device profile bit, by the EMCY that CANopenNode sends without its storage.
EMCY = Frame(0x085, bytes.fromhex("0050 11 2f 00000000"))

UNKNOWN_COMMAND = Frame(0x605, bytes.fromhex("e0 00 10 00 00000000"))


class Falling:
    """Takes a device back to PRE-OPERATIONAL whenever it hears one frame."""

    def __init__(self, laboratory, trigger, said):
        self.laboratory, self.trigger, self.said = laboratory, trigger, said
        self.due = []
        laboratory.hears, laboratory.says = self.hears, self.says

    def hears(self, frame):
        if frame != self.trigger:
            return [frame]
        self.due += self.said
        return [frame, ENTER_PRE_OPERATIONAL]

    def says(self, frame):
        due, self.due = self.due, []
        return [*due, frame]


def those(results, outcome):
    return [result for result in results if result.outcome is outcome]


@pytest.mark.parametrize(
    ("said", "cause"),
    [
        ([OPERATIONAL, EMCY], "the device leaves OPERATIONAL by EMCY 0x5000"),
        ([EMCY], "the device does not become OPERATIONAL: EMCY 0x5000 after START"),
        ([OPERATIONAL], "the device leaves OPERATIONAL: it reports no error"),
        ([], "the device does not become OPERATIONAL: it reports no error"),
        # 0000h is the end of an error, and causes nothing.
        ([EMCY._replace(data=bytes(8))], "the device does not become OPERATIONAL: it reports no"),
    ],
)
def test_a_device_that_leaves_operational_fails_one_check(laboratory, said, cause):
    Falling(laboratory, START, said)
    results = laboratory.run("NMT", "TPDO")
    (failed,) = those(results, Outcome.FAILED)
    assert failed.check.clause == "7.3.2.2.3"
    assert failed.detail.startswith(cause)
    not_run = those(results, Outcome.NOT_RUN)
    assert {result.detail for result in not_run} == {failed.detail}
    # Of NMT the commands and the SDO in OPERATIONAL; of TPDO all that wait for a PDO.
    assert len(not_run) >= 2 + 6
    assert report.not_run(results) == [f"{len(not_run)} checks not run: {failed.detail}"]


def test_a_fall_soon_after_the_start_is_seen_whatever_the_patience(laboratory):
    """The device leaves OPERATIONAL after the third of its heartbeats of 50 ms."""
    beats = []

    def says(frame):
        beats.extend([frame] if frame == OPERATIONAL else [])
        if len(beats) == 3:
            laboratory.node.receive(ENTER_PRE_OPERATIONAL, 0)
        return [frame]

    laboratory.dut.patience, laboratory.says = 0.001, says
    assert find_fall(laboratory.dut) == "the device leaves OPERATIONAL: it reports no error"


def test_the_whole_suite_names_the_cause_once(laboratory):
    Falling(laboratory, START, [OPERATIONAL, EMCY])
    results = laboratory.run()
    assert [result.check.clause for result in those(results, Outcome.FAILED)] == ["7.3.2.2.3"]
    assert "not run: the device leaves OPERATIONAL by EMCY 0x5000" in "".join(
        report.not_run(results)
    )


def test_errors_of_before_are_named_where_no_emcy_follows_the_command(laboratory):
    """The device reports its error once, with the boot-up message, and never obeys."""
    falling = Falling(laboratory, START, [])

    def says(frame):
        if frame == Frame(0x705, b"\0"):
            return [frame, EMCY]
        return [frame._replace(data=frame.data[:4] + b"\x11\0\0\0")] if reads(frame) else [frame]

    def reads(frame):
        return frame.can_id == 0x585 and frame.data[:3] == b"\x4f\x01\x10"

    laboratory.says = says
    (failed,) = those(laboratory.run("NMT"), Outcome.FAILED)
    assert falling.trigger is START
    assert failed.detail == (
        "the device does not become OPERATIONAL: EMCY 0x5000 came before, error register 0x11"
    )


def test_a_fall_within_a_check_is_named_by_it_and_ends_with_a_reset(laboratory):
    """The third SYNC takes the device out of OPERATIONAL for good, but for a reset."""
    state = {"syncs": 0, "fallen": False}

    def hears(frame):
        if frame.can_id == 0x080:
            state["syncs"] += 1
            if state["syncs"] == 3:
                state["fallen"] = True
                return [frame, ENTER_PRE_OPERATIONAL]
        if frame.data[:1] == b"\x82" and frame.can_id == 0x000:
            state["fallen"] = False
        return [] if frame == START and state["fallen"] else [frame]

    laboratory.hears = hears
    results = laboratory.run("TPDO")
    (failed,) = those(results, Outcome.FAILED)
    assert failed.check.text.startswith("type 1 is sent with every SYNC")
    assert failed.detail.startswith(
        "the device does not become OPERATIONAL: it reports no error, until its reset; 1800h: PDOs "
    )
    assert those(results, Outcome.NOT_RUN) == []


def test_a_device_that_stays_operational_is_judged_by_its_own_failures(laboratory):
    laboratory.hears = lost(0x080)
    results = laboratory.run("NMT", "TPDO")
    failed = those(results, Outcome.FAILED)
    assert len(failed) > 1
    assert not any("become OPERATIONAL" in result.detail for result in failed)
    assert those(results, Outcome.NOT_RUN) == []


class Silent:
    """Takes a device off the bus from one frame on, until the suite has asked it often enough."""

    def __init__(self, laboratory, trigger, until=10**9):
        self.trigger, self.until, self.unheard = trigger, until, None
        laboratory.hears = self.hears

    def hears(self, frame):
        if self.unheard is None and frame == self.trigger:
            self.unheard = 0
        if self.unheard is None or self.unheard > self.until:
            return [frame]
        self.unheard += frame.can_id == 0x605
        return []


def test_a_device_that_ends_at_a_reset_fails_one_check(laboratory):
    """CANopenNode's program ends at NMT reset node, where nobody starts it again."""
    Silent(laboratory, Frame(0x000, b"\x81\x05"))
    results = laboratory.run()
    (failed,) = those(results, Outcome.FAILED)
    assert failed is results[0]
    silent = "the device answers no SDO request"
    assert failed.detail.startswith(f"{silent} afterwards, for 5 s; no boot-up")
    assert len(those(results, Outcome.NOT_RUN)) == len(results) - 1
    since = f'{silent} since the check "reset node is followed by the boot-up message"'
    assert report.not_run(results) == [f"{len(results) - 1} checks not run: {since}"]


def test_a_device_that_falls_silent_while_nothing_is_written_fails_one_check(laboratory):
    Silent(laboratory, UNKNOWN_COMMAND)
    results = laboratory.run(allowed=Impact.READ)
    (failed,) = those(results, Outcome.FAILED)
    assert failed.check.text == "an unknown command specifier aborts with 0504 0001h"
    assert all(r.outcome is Outcome.NOT_RUN for r in results[results.index(failed) + 1 :])


def test_a_device_that_comes_back_is_judged_again(laboratory):
    """Twenty requests are more than the wait after the failed check takes, and fewer than all."""
    Silent(laboratory, UNKNOWN_COMMAND, until=20)
    results = laboratory.run(allowed=Impact.READ)
    assert len(those(results, Outcome.FAILED)) == 1
    outcomes = [result.outcome for result in results]
    last = max(k for k, outcome in enumerate(outcomes) if outcome is Outcome.NOT_RUN)
    assert Outcome.PASSED in outcomes[last:]


def test_a_recommendation_that_is_not_followed_is_no_failure(laboratory):
    """The device does not take up the event timer of its RPDO."""
    laboratory.hears = begun_otherwise(REQUEST, "2b001405", "2b001405 00000000")
    results = laboratory.run("RPDO")
    (result,) = those(results, Outcome.NOT_FOLLOWED)
    assert result.check.degree is Degree.RECOMMENDED
    assert "8250h" in result.detail
    assert report.failures(results) == []
    assert ", 0 failed, 1 not followed, " in report.summary(results)


def test_a_service_of_lss_that_is_not_there_is_not_applicable(laboratory):
    laboratory.hears = lost(LSS, "46")
    results = laboratory.run("LSS")
    assert those(results, Outcome.FAILED) == []
    (result,) = [r for r in results if r.check.clause == "CiA 305, identify remote slave"]
    assert (result.outcome, result.detail) == (
        Outcome.NOT_APPLICABLE,
        "no answer: the device does not have this service",
    )


@pytest.mark.parametrize(
    ("code", "outcome"), [(0x05040001, Outcome.PASSED), (0x05040002, Outcome.FAILED)]
)
def test_no_clause_names_the_code_for_a_segment_that_was_not_sent(laboratory, code, outcome):
    """0504 0003h and 0001h pass, as of the two the clause leaves open; 0002h is another error."""
    laboratory.says = aborted_otherwise(code, 0x05040003)
    results = laboratory.run("SDO block transfer", allowed=Impact.READ)
    (result,) = [r for r in results if r.check.text.startswith("confirming a segment")]
    assert result.outcome is outcome


def test_every_degree_is_that_of_some_check():
    found = {check.degree for chapter in CHAPTERS for check in chapter.checks}
    assert found == set(Degree)
    required = {c.title for c in CHAPTERS if c.degree is Degree.REQUIRED}
    assert required == {"NMT", "Object dictionary", "SDO upload", "SDO download"}


@pytest.mark.parametrize(
    ("says", "twice"),
    [
        (lambda frame: [frame], False),
        (lambda frame: [frame, frame], True),
        # 0x1018.04, by which alone two devices of a type differ
        (lambda frame: [frame] * (1 + (frame.data[1:4] == b"\x18\x10\x04")), True),
        # another client has asked, too
        (lambda frame: [Frame(0x605, b"\x40\0\x10\0\0\0\0\0"), frame, frame], False),
    ],
)
def test_two_nodes_of_one_node_id_answer_twice(laboratory, says, twice):
    laboratory.says = lambda frame: says(frame) if frame.can_id == 0x585 else [frame]
    assert laboratory.dut.sdo.answers_twice() is twice
