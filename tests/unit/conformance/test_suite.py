"""The suite on a sound device: it passes, and it is left as it was."""

import pytest
from support.changed_frames import ANSWER, HEARTBEAT, begun_otherwise, lost

from hil_bench.abilities.conformance.check import Impact
from hil_bench.abilities.conformance.suite import CHAPTERS, Outcome
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.object_dictionary import Access

# The heartbeat of device.eds is off, it has neither 0x1200 nor 0x1F80, and mappings of at most 4
# entries.
NOT_APPLICABLE = {"7.2.8.3.2.2", "7.5.2.33", "7.2.4.3.17", "CiA 302-2, 1F80h"}


def values(node):
    changing = {0x1001, 0x1003}  # what went wrong on purpose stays in the history
    return {
        (v.index, v.subindex): v.value
        for v in node.object_dictionary
        if v.index not in changing and v.access is not Access.WO
    }


def test_every_check_of_a_sound_device_passes(laboratory):
    results = laboratory.run()
    assert [r for r in results if r.outcome is Outcome.FAILED] == []
    skipped = [r.check.clause for r in results if r.outcome is Outcome.NOT_APPLICABLE]
    assert len(skipped) == 4
    assert set(skipped) == NOT_APPLICABLE
    assert len(results) == sum(len(chapter.checks) for chapter in CHAPTERS)


def test_what_was_changed_is_restored(laboratory):
    before = values(laboratory.node)
    laboratory.run()
    assert values(laboratory.node) == before
    assert laboratory.node.state is NmtState.PRE_OPERATIONAL


def test_reading_changes_nothing_and_asks_for_no_change(laboratory):
    heard = []
    laboratory.hears = lambda frame: heard.append(frame) or [frame]
    before = values(laboratory.node)
    results = laboratory.run(allowed=Impact.READ)
    assert {r.check.impact for r in results} == {Impact.READ}
    assert all(r.outcome is not Outcome.FAILED for r in results)
    assert values(laboratory.node) == before
    # Neither NMT, nor SYNC, nor a download: command specifiers 1 (initiate) and 6 (block).
    assert not [frame for frame in heard if frame.can_id in {0x000, 0x080, 0x205}]
    requests = [frame.data[0] for frame in heard if frame.can_id == 0x605 and frame.data]
    assert not [command for command in requests if command >> 5 in {1, 6}]


def test_writing_leaves_what_is_stored_alone(laboratory):
    results = laboratory.run(allowed=Impact.WRITE)
    assert {r.check.impact for r in results} == {Impact.READ, Impact.WRITE}


def test_a_value_is_restored_where_the_check_fails(laboratory):
    # The answer to reading back 0x1017 is always 7 ms: the download check fails half way.
    laboratory.says = begun_otherwise(ANSWER, "4b171000", "4b171000 07000000")
    assert "download_expedited" in laboratory.failed_checks("SDO download")
    assert laboratory.node.object_dictionary.variable(0x1017).value == 7  # as it said it was


def test_a_device_that_goes_silent_fails_everything_that_needs_an_answer(laboratory):
    laboratory.says = lambda _frame: []
    results = laboratory.run(allowed=Impact.READ)
    passed = {r.check.text for r in results if r.outcome is Outcome.PASSED}
    assert passed <= {
        # Silence is what these ask for, or they ask for nothing more.
        "what is no SDO request gets no answer",
        "a device answers requests to itself only",
    }


def test_every_check_says_what_is_right_in_a_line():
    checks = [check for chapter in CHAPTERS for check in chapter.checks]
    assert len(checks) > 120
    assert all(check.text and "\n" not in check.text and check.judge.__doc__ for check in checks)
    assert len({(check.clause, check.text) for check in checks}) >= len(checks) - 1


def test_an_abort_names_the_object_of_its_transfer(laboratory):
    # Some servers do not heed an abort of another object, and stay in the transfer.
    requests = []
    laboratory.hears = lambda frame: requests.append(frame) or [frame]
    laboratory.run("SDO upload", "SDO block transfer", allowed=Impact.READ)
    begun, aborts = bytes(3), 0
    for data in [f.data for f in requests if f.can_id == 0x605 and not f.is_extended]:
        if len(data) == 8 and data[0] in {0x40, 0xA4}:
            begun = data[1:4]
        elif data[:1] == b"\x80":
            assert data[1:4] == begun
            aborts += 1
    assert aborts > 3


def test_a_heartbeat_that_is_on_is_judged_without_writing(laboratory):
    laboratory.dut.write(0x1017, 0, 100)
    (result,) = laboratory.run("Error control", allowed=Impact.READ)
    assert (result.outcome, result.detail) == (Outcome.PASSED, "every 100.0 ms")
    laboratory.says = lambda f: [f._replace(data=b"\x06")] if f.can_id == 0x705 else [f]
    (result,) = laboratory.run("Error control", allowed=Impact.READ)
    assert "heartbeat 06; one byte of 04, 05 or 7F is right" in result.detail
    laboratory.says = lost(HEARTBEAT)
    (result,) = laboratory.run("Error control", allowed=Impact.READ)
    assert result.detail == "no heartbeat, though 1017h is 100 ms"


def heartbeats_of_another(laboratory, period):
    """Another node with the same node-ID, which has no SDO, sends its heartbeat by a period [s]."""
    due = 0.0

    def says(frames):
        nonlocal due
        now = laboratory.bus.now()
        if now < due:
            return frames
        due = now + period
        return [*frames, Frame(HEARTBEAT, b"\x05")]

    laboratory.beside = says


@pytest.mark.parametrize(
    ("own", "other", "found"),
    [
        (0, 1.0, "heartbeat 05, though 1017h is 0; "),
        # Between two of its own come three at least: no distance is longer than 330 ms.
        (1000, 0.33, "a heartbeat every "),
        # Two that come in turn halve the period in the mean.
        (1000, 1.0, "a heartbeat every "),
    ],
)
def test_heartbeats_of_another_node_are_heard_without_writing(laboratory, own, other, found):
    laboratory.dut.write(0x1017, 0, own)
    heartbeats_of_another(laboratory, other)
    (result,) = laboratory.run("Error control", allowed=Impact.READ)
    assert result.outcome is Outcome.FAILED
    assert result.detail.startswith(found)
    assert result.detail.endswith("does another node have this node-ID, too?")


def test_answers_to_the_guarding_of_a_master_are_no_heartbeat(laboratory):
    request = Frame(HEARTBEAT, is_remote=True)
    laboratory.says = lambda frame: [request, frame] if frame.can_id == HEARTBEAT else [frame]
    heartbeats_of_another(laboratory, 0.3)
    own = laboratory.beside

    def guarded(frames):
        return [each for frame in own(frames) for each in laboratory.says(frame)]

    laboratory.beside = guarded
    (result,) = laboratory.run("Error control", allowed=Impact.READ)
    assert result.detail == "the heartbeat is off (1017h is 0)"


def test_a_long_period_is_not_said_to_be_measured(laboratory):
    laboratory.dut.write(0x1017, 0, 3000)
    (result,) = laboratory.run("Error control", allowed=Impact.READ)
    assert result.detail == "one came; 1017h is 3000 ms, which was not measured"


SMALLEST = """
[FileInfo]
FileName=smallest.eds

[DeviceInfo]

[MandatoryObjects]
SupportedObjects=3
1=0x1000
2=0x1001
3=0x1018

[1000]
ParameterName=Device type
ObjectType=0x7
DataType=0x0007
AccessType=ro

[1001]
ParameterName=Error register
ObjectType=0x7
DataType=0x0005
AccessType=ro

[1018]
ParameterName=Identity
ObjectType=0x9
SubNumber=2

[1018sub0]
ParameterName=Highest sub-index
ObjectType=0x7
DataType=0x0005
AccessType=ro
DefaultValue=1

[1018sub1]
ParameterName=Vendor-ID
ObjectType=0x7
DataType=0x0007
AccessType=ro
"""


def test_the_smallest_device_passes_and_the_rest_is_not_applicable(make_laboratory, make_file):
    path = make_file("smallest.eds", SMALLEST)
    results = make_laboratory(path).run()
    assert [r for r in results if r.outcome is Outcome.FAILED] == []
    skipped = [r for r in results if r.outcome is Outcome.NOT_APPLICABLE]
    assert all(r.detail for r in skipped)
    # NMT, SDO and what mandatory objects there are; node guarding is there without 0x100C, too.
    assert {r.chapter for r in results if r.outcome is Outcome.PASSED} == {
        "NMT",
        "Object dictionary",
        "SDO upload",
        "SDO download",
        "SDO block transfer",
        "SYNC and TIME",
    }
