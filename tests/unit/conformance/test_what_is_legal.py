"""Devices that do what CiA 301 allows, though otherwise than ours: nothing fails."""

import re
from types import SimpleNamespace

import pytest
from support.changed_frames import (
    ANSWER,
    LSS,
    REQUEST,
    aborted_otherwise,
    altered,
    begun_otherwise,
    lost,
)

from hil_bench.abilities.conformance.check import Impact
from hil_bench.abilities.conformance.suite import CHAPTERS, Outcome, run_suite
from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.errors import SdoAbort

TEXT = 0x2020


def check_all(laboratory):
    """Run everything: nothing fails. Return outcome and detail by what is right."""
    results = laboratory.run()
    assert [r for r in results if r.outcome is Outcome.FAILED] == []
    return {r.check.text: (r.outcome, r.detail) for r in results}


def refuse(code, unless):
    """A check of an object's new value."""

    def check(value):
        if not unless(value):
            raise SdoAbort(*code)

    return check


LONG_TEXT = "a segmented download of a long object is read back"
LONG_BLOCK = "a block download with CRC is taken and read back"


@pytest.mark.parametrize(
    ("present", "code", "takes", "size"),
    [
        # A text is bounded; the longest that this suite tries below 10 bytes has 8.
        ("abc", abort_codes.LENGTH_TOO_HIGH, lambda text: len(text) <= 10, 8),
        ("abc", abort_codes.LENGTH, lambda text: len(text) <= 20, 15),
        # A text has one length.
        ("sixteen letters.", abort_codes.LENGTH_TOO_LOW, lambda text: len(text) == 16, 16),
        # A text has a form, such as that of an address.
        ("10.0.0.1", abort_codes.VALUE, lambda text: text.startswith("10."), 8),
    ],
)
def test_texts_of_any_capacity(laboratory, present, code, takes, size):
    text = laboratory.node.object_dictionary.variable(TEXT)
    text.default = text.value = present
    text.add_check(refuse(code, unless=takes))
    found = check_all(laboratory)
    assert found[LONG_TEXT] == (Outcome.PASSED, f"0x2020.00, {size} bytes")
    outcome, detail = found[LONG_BLOCK]
    assert outcome is Outcome.PASSED
    assert f"0x2020.00, {size} bytes" in detail
    assert text.value == present


def test_a_value_beyond_its_limits_may_be_refused_in_general(laboratory):
    """0609 0030h is right beside 0031h and 0032h, which say which way (CiA 301, table 22)."""
    laboratory.says = aborted_otherwise(0x06090030, 0x06090031, 0x06090032)
    assert laboratory.failed("Object dictionary") == []


def test_a_text_that_takes_nothing_is_not_judged(laboratory):
    text = laboratory.node.object_dictionary.variable(TEXT)
    text.default = text.value = ""
    text.add_check(refuse(abort_codes.LENGTH_TOO_HIGH, unless=lambda value: not value))
    outcome, detail = check_all(laboratory)[LONG_TEXT]
    assert outcome is Outcome.NOT_APPLICABLE
    assert detail.startswith("0x2020.00 takes no text of this suite (47 bytes: 0607 0012h")


def test_a_text_that_is_filled_up_with_zeros(laboratory):
    text = laboratory.node.object_dictionary.variable(TEXT)

    def fill(value):
        text.value = value.ljust(200, "\0")

    text.add_hook(fill)
    assert check_all(laboratory)[LONG_TEXT][0] is Outcome.PASSED


def test_a_device_that_waits_on_after_segment_0(laboratory):
    laboratory.hears = lost(REQUEST, "00 00000000000000")
    assert laboratory.failed("SDO block transfer") == []


@pytest.mark.parametrize(("confirmed", "failures"), [(0, 0), (1, 1)])
def test_a_device_that_asks_for_the_first_segment_after_segment_0(laboratory, confirmed, failures):
    """As CANopenNode does when its time has passed; to confirm segment 1 would be wrong."""
    heard = []

    def hears(frame):
        if frame.can_id == 0x605:
            heard.append(frame.data)
        return [frame]

    def says(frame):
        is_it = frame.can_id == 0x585 and heard and heard[-1] == bytes(8)
        return [frame._replace(data=bytes((0xA2, confirmed, 127)) + bytes(5))] if is_it else [frame]

    laboratory.hears, laboratory.says = hears, says
    assert len(laboratory.failed("SDO block transfer")) == failures


def test_a_device_that_takes_no_crc(laboratory):
    """Bit 2 of its answer to the initiation of a block download is 0 (CiA 301, 7.2.4.3.9)."""
    laboratory.says = begun_otherwise(ANSWER, "a4", "a0")
    found = laboratory.result("SDO block transfer", "a wrong CRC aborts with 0504 0004h")
    assert found == (Outcome.NOT_APPLICABLE, "the device takes no CRC")


@pytest.mark.parametrize("heartbeat", [0, 100])
def test_a_heartbeat_of_its_own_is_switched_off_where_it_is_guarded(make_variant, heartbeat):
    found = [result.outcome for result in make_variant(heartbeat=heartbeat).run("Error control")]
    assert set(found) <= {Outcome.PASSED, Outcome.NOT_APPLICABLE}
    assert found.count(Outcome.PASSED) > 4


def test_a_heartbeat_is_waited_for_whatever_the_patience_for_answers(laboratory):
    """One of 100 ms comes within 0.4 s; no node guarding (CiA 301, 7.2.8.2) stands in for it."""
    laboratory.dut.patience = 0.001
    laboratory.hears = lambda f: [] if f.is_remote else [f]
    with laboratory.dut.watched():
        for _ in range(4):  # at different times between two heartbeats
            laboratory.dut.wire.wait(0.037)
            assert laboratory.dut.state() is NmtState.PRE_OPERATIONAL


@pytest.mark.parametrize(
    ("low", "high", "is_changed"),
    [(0, 1, True), (1, 5, True), (2, 5, False), (None, 0, False), (-7, None, True)],
)
def test_an_rpdo_carries_values_within_the_limits_of_its_objects(laboratory, low, high, is_changed):
    """RPDO 1 carries 2000h and 2001h, which are 0: the other value that is tried is 1."""
    for index in (0x2000, 0x2001):
        laboratory.dut.objects.variable(index).low = low
        laboratory.dut.objects.variable(index).high = high
    sent = []
    laboratory.hears = lambda f: sent.append(f) or [f]
    laboratory.run("RPDO")
    payloads = {frame.data for frame in sent if frame.can_id == 0x205}
    assert (b"\x01\0\x01\0" in payloads) is is_changed


@pytest.mark.parametrize("startup", [0, 4])
def test_a_device_that_starts_by_itself(make_variant, startup):
    """Ours refuses "save" in OPERATIONAL with 0800 0022, as a device may."""
    laboratory = make_variant(startup=startup)
    check_all(laboratory)
    assert laboratory.node.object_dictionary.variable(0x1F80).value == startup


@pytest.mark.parametrize(
    ("command", "outcome"), [(b"\x01\x05", Outcome.PASSED), (b"\x02\x05", Outcome.FAILED)]
)
def test_a_device_without_1f80_may_start_by_itself(laboratory, command, outcome):
    """OPERATIONAL it may be, STOPPED it may not."""

    def says(frame):
        if frame.can_id == 0x705 and frame.data == b"\0":
            laboratory.node.receive(Frame(0x000, command), 0)
        return [frame]

    laboratory.says = says
    text = "the node enters PRE-OPERATIONAL after the boot-up message"
    assert laboratory.result("NMT", text)[0] is outcome


def test_save_is_asked_for_in_pre_operational(make_variant):
    laboratory = make_variant(startup=0)
    assert laboratory.node.state is NmtState.OPERATIONAL
    (chapter,) = [chapter for chapter in CHAPTERS if chapter.title == "Store and restore"]
    stored = [check for check in chapter.checks if check.impact is Impact.STORE]
    alone = SimpleNamespace(title=chapter.title, checks=stored)
    results = run_suite(laboratory.dut, Impact.STORE, [alone])
    assert {r.outcome for r in results} == {Outcome.PASSED}


def test_no_lss_where_none_is_claimed(laboratory):
    laboratory.hears = lost(LSS)
    found = check_all(laboratory)
    assert found["a device that claims LSS answers to it"] == (
        Outcome.NOT_APPLICABLE,
        "the EDS does not say LSS_Supported=1",
    )


@pytest.mark.parametrize("code", [0x06070012, 0x06070013])
def test_the_general_abort_code_of_a_wrong_length(laboratory, code):
    laboratory.says = aborted_otherwise(0x06070010, code)
    check_all(laboratory)


def test_what_the_eds_says_wrongly_is_not_judged(make_laboratory, eds_path, make_file):
    """The device type that the file gives is no number, a constant text is not ASCII."""
    text = eds_path.read_text(encoding="utf-8")
    text = text.replace("DefaultValue=0x00000191", "DefaultValue=four")
    text, count = re.subn(
        r"AccessType=\w+\nDefaultValue=Test device", "AccessType=const\nDefaultValue=Gerät", text
    )
    assert count == 1
    path = make_file("doubtful.eds", text)
    laboratory = make_laboratory(path)
    for index, value in ((0x1000, 0x191), (0x1008, "Geraet")):
        variable = laboratory.node.object_dictionary.variable(index)
        variable.default = variable.value = value
    found = check_all(laboratory)
    assert found["1000h has the device type of the EDS"] == (
        Outcome.NOT_APPLICABLE,
        "what the EDS says of 0x1000.00 is in doubt",
    )


@pytest.mark.parametrize(
    ("section", "text", "reason"),
    [
        ("1000", "1000h has the device type of the EDS", "the EDS gives 0x1000.00 no value"),
        ("1018sub[123]", "1018h has the identity of the EDS", "the EDS gives no identity"),
        ("1017", "after restore and a reset the defaults of the EDS are there",
         "the EDS gives 1017h no default"),
        ("....(?:sub[0-9A-F]+)?", "every constant of the EDS holds the value that the EDS gives",
         "the EDS gives no constant a value"),
    ],
)  # fmt: skip
def test_what_the_eds_leaves_open_is_not_judged(
    make_laboratory, eds_path, make_file, section, text, reason
):
    eds = eds_path.read_text(encoding="utf-8")
    opened = re.sub(rf"(\n\[{section}\][^\[]*?\nDefaultValue=).*", r"\1", eds)
    assert opened != eds
    laboratory = make_laboratory(eds_path)
    laboratory.dut.objects = load_eds(make_file("open.eds", opened), laboratory.dut.node_id)
    (title,) = [c.title for c in CHAPTERS if text in {check.text for check in c.checks}]
    assert laboratory.result(title, text) == (Outcome.NOT_APPLICABLE, reason)


def test_an_identifier_of_sync_that_the_eds_gives_is_not_the_standards(
    make_laboratory, eds_path, make_file
):
    text = eds_path.read_text(encoding="utf-8")
    text, count = re.subn(r"(\n\[1005\][^\[]*?\nDefaultValue=).*", r"\g<1>0x81", text)
    assert count == 1
    laboratory = make_laboratory(make_file("sync.eds", text))
    assert laboratory.result("SYNC and TIME", "1005h is 80h by default") == (
        Outcome.NOT_APPLICABLE,
        "configured to 00000081h",
    )


def test_either_abort_code_for_mapping_what_is_not_there(laboratory):
    """CANopenNode answers 0604 0041, Lely 0602 0000; CiA 301 names both."""
    laboratory.says = aborted_otherwise(
        0x06040041, 0x06020000, where=lambda data: data[1:3] in {b"\x00\x16", b"\x00\x1a"}
    )
    check_all(laboratory)


def test_an_rpdo_that_is_kept_after_the_synchronous_window(laboratory):
    """CANopenNode does so: by CiA 301 a device may discard it."""
    laboratory.hears = begun_otherwise(REQUEST, "23071000", "23071000 00000000")
    found = check_all(laboratory)
    assert found["an RPDO within the synchronous window acts, one after it may not"] == (
        Outcome.PASSED,
        "1400h kept after the window; 1401h: what it carries cannot all be read",
    )


def test_lss_without_bit_timing(laboratory):
    """CANopenNode answers the service only where the application can change its bit rate."""
    laboratory.hears = lost(LSS, "13")
    assert check_all(laboratory)["a reserved bit timing is refused"] == (
        Outcome.NOT_APPLICABLE,
        "no answer: the device does not have this service",
    )


def test_a_device_may_have_one_event_driven_type(laboratory):
    """254 is of the maker, 255 of the profile (7.5.2.37)."""
    laboratory.hears = begun_otherwise(REQUEST, "2f001802 fe", "2f001802 f1")  # reserved: refused
    assert laboratory.failed_checks("TPDO") == []


def test_a_block_upload_may_come_without_its_size(laboratory):
    """CiA 301, 7.2.4.3.13: with s = 0 the four bytes of the size are reserved."""
    laboratory.says = altered(
        ANSWER, lambda d: bytes([d[0] & ~2]) + d[1:4] + bytes(4) if d[0] in {0xC2, 0xC6} else d
    )
    assert laboratory.failed("SDO block transfer") == []
