"""A bus that speaks neither CANopen nor J1939 is not judged by their rules, and no pass is said.

The frames are as those of cars and test cells: identifiers that CiA 301 gives to its services, with
other lengths and contents.
"""

import pytest
from support.sdo_frames import MS, heard, upload

from hil_bench.abilities.eyes.explain.explain import explain
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import LoggedFrame

BITRATE = 500_000
CAR = (
    Frame(0x0C9, bytes.fromhex("840BCD0700400800")),  # would be an EMCY with a code of nobody
    Frame(0x1F5, bytes(8)),
    Frame(0x60D, bytes.fromhex("0006000000000000")),  # an SDO segment of no transfer
    Frame(0x625, bytes.fromhex("3200FF1C0000")),  # an SDO request of six bytes
    Frame(0x710, bytes(8)),  # a heartbeat of eight
)
SEGMENT = ((0x605, 0x60), (0x585, 0x00))  # a request for one, and one (CiA 301, 7.2.4.3.7)
PDOS = (Frame(0x1A4, bytes(8)), Frame(0x294, bytes(7)), Frame(0x405, b"\x01"))
ONE_WORD_OF_CANOPEN = {
    "NMT": (Frame(0x000, b"\x01\x00"),),
    "heartbeat": (Frame(0x705, b"\x05"),),
    "node guarding": (Frame(0x705, is_remote=True),),
    "SYNC": (Frame(0x080),),
    "LSS": (Frame(0x7E5, bytes.fromhex("0401000000000000")),),
    "SDO": tuple(upload(5, 0x1000, 0, b"\x94\x01\x00\x00")),
}


def explained(*frames, known=()):
    return explain(heard(*frames, step=MS), known, BITRATE)


@pytest.mark.parametrize("count", [1, 50])
def test_a_car_is_accused_of_nothing_and_not_called_sound(count):
    found = explained(*CAR * count)
    assert (found.findings, found.languages, found.is_judged, found.nodes) == ((), (), False, ())
    (note,) = found.notes
    against = f"{4 * count} of {5 * count} frames are not as CiA 301 has them, the first at 0.000 s"
    assert note == f"this is no CANopen: {against}: 0C9 [84 0B CD 07 00 40 08 00]"


@pytest.mark.parametrize("frame", CAR[:1] + CAR[2:])
def test_each_of_its_frames_is_no_canopen(frame):
    assert not explained(*PDOS, frame).is_judged
    assert "the first at 0.003 s" in explained(*PDOS, frame).notes[0]


@pytest.mark.parametrize(
    "frame",
    [
        Frame(0x000, b"\x07\x00"),  # an NMT command that is none
        Frame(0x000, b"\x01"),
        Frame(0x080, b"\x01\x02"),  # a SYNC of two bytes
        Frame(0x701, b"\x33"),  # a state that is none
        Frame(0x7E5, b"\x33" + bytes(7)),  # an LSS command that is none
        Frame(0x601, bytes.fromhex("4002010000000000")),  # reads object 0x0102
    ],
)
def test_contents_that_canopen_does_not_have_are_against_it(frame):
    assert explained(*PDOS, frame).notes[0].startswith("this is no CANopen: 1 of 4 frames")


def test_the_middle_of_a_transfer_may_be_what_the_log_begins_with():
    asked, answered = (Frame(can_id, bytes([first]) + bytes(7)) for can_id, first in SEGMENT)
    again, more = (Frame(can_id, bytes([first | 0x10]) + bytes(7)) for can_id, first in SEGMENT)
    found = explained(*(asked, answered, again, more) * 10)
    (note,) = found.notes
    either = "this is no CANopen, or the log begins within SDO transfers: 40 of 40 frames"
    assert (note.startswith(either), found.is_judged) == (True, False)
    (note,) = explained(asked, answered, *CAR[:1]).notes
    assert note.startswith("this is no CANopen: 3 of 3 frames")


def test_identifiers_of_pdos_alone_show_nothing():
    found = explained(*PDOS * 20)
    assert (found.findings, found.is_judged) == ((), False)
    assert found.notes[0].startswith("none of 60 frames shows that CANopen or J1939 is spoken")
    assert explained(*PDOS, known=[KnownNode(0x24, "valve")]).is_judged


@pytest.mark.parametrize("name", ONE_WORD_OF_CANOPEN)
def test_what_only_canopen_has_shows_it(name):
    found = explained(*PDOS * 3, *ONE_WORD_OF_CANOPEN[name])
    assert (found.languages, found.is_judged) == (("CANopen",), True)
    assert not [note for note in found.notes if "CANopen" in note]


@pytest.mark.parametrize(("foreign", "is_spoken"), [(40, True), (41, False)])
def test_one_frame_in_twenty_is_enough_beside_others(foreign, is_spoken):
    """Two heartbeats beside a device of another kind on the same bus."""
    frames = [Frame(0x705, b"\x05")] * 2 + [Frame(0x710, bytes(8))] * foreign
    assert explained(*frames).is_judged == is_spoken


def test_eight_bytes_at_the_identifier_of_an_emcy_are_none_by_themselves():
    """0x0A1 with the code 0x8110 of CiA 301; a heartbeat of any node shows that it is one."""
    frame = Frame(0x0A1, bytes.fromhex("1081110000000000"))
    found = explained(*PDOS, frame)
    assert (found.findings, found.is_judged) == ((), False)
    (finding,) = explained(*PDOS, frame, Frame(0x701, b"\x05")).findings
    assert finding.cause is Cause.EMCY
    assert explained(frame, known=[KnownNode(0x21, "valve")]).findings


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        (Frame(0x000, bytes(8)), "2 with 000, the first at {} s: is no NMT message of 2 bytes"),
        (Frame(0x080, bytes(2)), "2 with 080, the first at {} s: 2 bytes, 0 or 1 are right"),
    ],
)
def test_messages_to_all_nodes_of_another_length_are_wrong_where_canopen_is_spoken(frame, said):
    (finding,) = explained(Frame(0x705, b"\x05"), frame, frame).findings
    assert finding.cause is Cause.WRONG_LENGTH
    assert finding.text == said.format(f"{finding.sights[0].now * 1e-9:.3f}")
    assert not explained(*PDOS, frame, frame).findings


def test_a_request_without_an_answer_is_a_dead_node_and_no_foreign_bus():
    (finding,) = explained(*[Frame(0x605, bytes.fromhex("4000100000000000"))] * 3).findings
    assert finding.cause is Cause.NO_BOOT_UP


@pytest.mark.parametrize(("after_ms", "is_missing"), [(1000, False), (1001, True)])
def test_a_last_request_has_no_time_for_an_answer(after_ms, is_missing):
    """A node-guarding request in the last second of a recording."""
    request = Frame(0x704, b"", is_remote=True)
    frames = [(0, Frame(0x181, bytes(8))), (10, request), (10 + after_ms, Frame(0x181, bytes(8)))]
    log = [LoggedFrame(frame, time * 1_000_000, None) for time, frame in frames]
    assert bool(explain(log, [], 1_000_000).findings) is is_missing


def test_nodes_that_are_known_are_judged_all_the_same():
    known = [KnownNode(5, "valve")]
    causes = {each.cause for each in explained(*CAR * 3, known=known).findings}
    assert causes
    assert not explained(*CAR * 3, known=known).is_judged


def test_address_claims_show_j1939():
    found = explained(Frame(0x18EEFF05, bytes(8), is_extended=True))
    assert (found.languages, found.is_judged, found.notes) == (("J1939",), True, ())
