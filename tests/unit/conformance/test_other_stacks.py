"""What CANopenNode and Lely do otherwise, where no clause says what is right: nothing fails.

The bytes are those that the two sent to this suite (docs/benchmarks.md has the versions); the node
of the other tests is changed to send them, and a neighbour of each that is wrong still fails.
"""

import pytest
from support.changed_frames import ANSWER, EMCY, HEARTBEAT, REQUEST, altered, begun_otherwise, lost

from hil_bench.abilities.conformance.suite import Outcome
from hil_bench.canopen_device.frame import Frame


def test_a_segment_with_a_wrong_toggle_bit_may_be_ignored(laboratory):
    """Lely keeps still: it takes the segment for one that it has already."""
    laboratory.hears = lost(REQUEST, "1bd204")
    found = laboratory.result("SDO download", "a segment with a wrong toggle bit")
    assert found == (Outcome.PASSED, "it counts for nothing")


def test_a_segment_with_a_wrong_toggle_bit_must_not_be_taken(laboratory):
    laboratory.hears = begun_otherwise(REQUEST, "1bd204", "0bd204")
    laboratory.says = lost(ANSWER, "20")
    outcome, _ = laboratory.result("SDO download", "a segment with a wrong toggle bit")
    assert outcome is Outcome.FAILED


def test_a_request_of_seven_bytes_may_be_served(laboratory):
    laboratory.hears = lambda f: (
        [f._replace(data=f.data.ljust(8, b"\0"))] if len(f.data) == 7 else [f]
    )
    found = laboratory.result("SDO upload", "what is no SDO request")
    assert found == (Outcome.PASSED, "a request of seven bytes is served")


def test_a_request_with_a_29_bit_identifier_may_not(laboratory):
    """As the node of python-canopen does; the line says which frame it was."""
    laboratory.hears = lambda f: [f._replace(is_extended=False)]
    outcome, detail = laboratory.result("SDO upload", "what is no SDO request")
    assert outcome is Outcome.FAILED
    assert detail.startswith("a 29-bit identifier: answer 43 00 10 00 ")


@pytest.mark.parametrize(
    ("confirmed", "outcome"), [("a20101", Outcome.PASSED), ("a20001", Outcome.FAILED)]
)
def test_more_segments_may_be_confirmed_than_were_sent(laboratory, confirmed, outcome):
    """Lely takes A2 7F 01 for all that it has sent; a device that sends them again is wrong."""
    laboratory.hears = begun_otherwise(REQUEST, "a27f01", f"{confirmed} 0000000000")
    found = laboratory.result("SDO block transfer", "confirming a segment that was not sent")
    assert found[0] is outcome
    if outcome is Outcome.PASSED:
        assert found[1] == "goes on behind what was sent"


@pytest.mark.parametrize(
    ("code", "outcome"), [(0x05040001, Outcome.PASSED), (0x05040000, Outcome.FAILED)]
)
def test_a_short_block_download_aborts_by_either_code(laboratory, code, outcome):
    """Lely: 0504 0001h to D9."""
    heard = []

    def hears(frame):
        heard.append(frame.data[:1])
        return [frame]

    laboratory.hears = hears
    laboratory.says = altered(
        ANSWER,
        lambda data: (
            data[:4] + code.to_bytes(4, "little")
            if data[:1] == b"\x80" and heard[-1] == b"\xd9"
            else data
        ),
    )
    assert laboratory.result("SDO block transfer", "fewer bytes")[0] is outcome


def test_node_guarding_may_need_a_life_time(laboratory):
    """Lely answers remote frames with 100Ch and 100Dh set only."""
    objects = laboratory.node.object_dictionary

    def hears(frame):
        is_guarded = objects.variable(0x100C).value and objects.variable(0x100D).value
        return [frame] if not frame.is_remote or is_guarded else []

    laboratory.hears = hears
    found = laboratory.result("Error control", "node guarding is answered")
    assert found == (Outcome.PASSED, "with 100Ch and 100Dh set")


@pytest.mark.parametrize(("register", "outcome"), [(0x11, Outcome.PASSED), (0, Outcome.FAILED)])
@pytest.mark.parametrize(
    ("title", "text"), [("EMCY", "when the error is gone"), ("Error control", "life guarding")]
)
def test_an_error_may_stay_until_a_reset(laboratory, title, text, register, outcome):
    """Lely's BasicSlave sends no EMCY 0000h, and its error register keeps the bits."""

    def says(frame):
        if frame.can_id == EMCY and frame.data[:2] == b"\0\0":
            return []
        if frame.can_id == ANSWER and frame.data[:4] == b"\x4f\x01\x10\0":
            return [frame._replace(data=frame.data[:4] + bytes([register, 0, 0, 0]))]
        return [frame]

    laboratory.says = says
    found = laboratory.result(title, text)
    assert found[0] is outcome
    if outcome is Outcome.PASSED:
        assert found[1] == "the device keeps the error, 1001h is 11h"


def test_the_end_of_an_error_is_no_error(laboratory):
    """CANopenNode sends EMCY 0000h when 1016h is written: nobody was missed."""
    ends = Frame(EMCY, bytes.fromhex("0000 00 1b 00000000"))
    laboratory.says = lambda f: [f, ends] if f.data[:4] == b"\x60\x16\x10\x01" else [f]
    assert laboratory.result("Error control", "nobody is watched")[0] is Outcome.PASSED


@pytest.mark.parametrize(("answers", "outcome"), [(1, Outcome.PASSED), (2, Outcome.FAILED)])
def test_one_heartbeat_after_a_remote_frame_is_no_answer_to_it(laboratory, answers, outcome):
    """CANopenNode sends the first heartbeat of a new period when it comes to it."""
    due, objects = [], laboratory.node.object_dictionary

    def hears(frame):
        is_watched = objects.variable(0x1017).value == 10_000
        if not (is_watched and frame.is_remote) or len(due) == answers:
            return [frame]
        due.append(frame)  # the answer to this read is made the heartbeat
        return [frame, Frame(REQUEST, bytes.fromhex("40 0A C0 00 00000000"))]

    laboratory.hears = hears
    laboratory.says = lambda f: (
        [Frame(HEARTBEAT, b"\x7f")] if f.data[:4] == b"\x80\x0a\xc0\0" else [f]
    )
    assert laboratory.result("Error control", "a heartbeat excludes")[0] is outcome
