"""Devices that lack a service or a check: the suite names it, under one clause."""

import struct

import pytest
from support.changed_frames import HEARTBEAT, LSS, REQUEST, aborted_otherwise, begun_otherwise, lost

from hil_bench.abilities.conformance.suite import Outcome
from hil_bench.canopen_device.frame import Frame


def test_lss_that_is_claimed_and_mute(make_variant):
    laboratory = make_variant(claims_lss=True)
    laboratory.hears = lost(LSS)
    assert laboratory.failed("LSS") == [
        ("CiA 306, LSS_Supported", "a device that claims LSS answers to it")
    ]


@pytest.mark.parametrize(
    ("answers_own", "outcome"), [(True, Outcome.FAILED), (False, Outcome.NOT_APPLICABLE)]
)
def test_who_answers_a_fastscan_is_found_out(laboratory, answers_own, outcome):
    """The device itself, which has a node-ID, or another one whose numbers differ."""
    objects = laboratory.dut.objects
    vendor, product, revision, serial = [objects.number(0x1018, part) for part in range(1, 5)]
    own = (vendor, product, revision, serial)
    bounds = (vendor, product, revision, revision, serial, serial)

    def hears(frame):
        if frame.can_id != 0x7E5 or frame.data[0] != 0x51:
            return [frame]
        number, bit_check, part = struct.unpack_from("<IBB", frame.data, 1)
        if bit_check != 0x80 and not (answers_own and number == own[part]):
            return []
        # "Identify remote slave" by its own address has the same answer, 0x4F.
        return [
            frame._replace(data=struct.pack("<BI3x", specifier, bound))
            for specifier, bound in enumerate(bounds, start=0x46)
        ]

    laboratory.hears = hears
    found = {result.check.clause: result.outcome for result in laboratory.run("LSS")}
    assert found.pop("CiA 305, fastscan") is outcome
    assert set(found.values()) <= {Outcome.PASSED}


def test_another_emcy_identifier_that_is_taken_is_taken_back(laboratory):
    """The device takes what is written while its EMCY is valid; 7.5.2.17 forbids it."""
    own = laboratory.node.object_dictionary.variable(0x1014)

    def hears(frame):
        if frame.can_id == 0x605 and frame.data == bytes.fromhex("23 14 10 00 85010000"):
            own.value = 0x185
            laboratory.says = confirm
        return [frame]

    def confirm(frame):
        if frame.can_id == 0x585 and frame.data[:1] == b"\x80":
            laboratory.says = lambda frame: [frame]
            return [frame._replace(data=bytes.fromhex("60 14 10 00 00000000"))]
        return [frame]

    laboratory.hears = hears
    assert laboratory.failed("EMCY") == [
        ("7.5.2.17", "the identifier of a valid EMCY cannot be changed")
    ]
    assert own.value == 0x085


@pytest.mark.parametrize(
    ("index", "low", "high", "verb"), [(0x2028, -5, 5, "took"), (0x2022, None, 9, "confirmed")]
)
def test_a_number_of_four_bytes_beyond_its_limits(laboratory, index, low, high, verb):
    """The EDS has limits that the device does not know."""
    variable = laboratory.dut.objects.variable(index)
    variable.low, variable.high = low, high
    results = laboratory.run("Object dictionary")
    (detail,) = [r.detail for r in results if r.outcome is Outcome.FAILED]
    wrong = {"-6": low, str(high + 1): high}
    for value, limit in wrong.items():
        said = f"0x{index:04X}.00 {verb} {value}, which is beyond its limits"
        assert (said in detail) is (limit is not None)
    if verb == "took":  # what can be read is written back
        assert laboratory.node.object_dictionary.number(index) == variable.default


def test_a_text_shorter_than_announced_is_taken(laboratory):
    # The size in the first request of a segmented download of a text is not looked at.
    laboratory.hears = begun_otherwise(REQUEST, "21202000", "20202000 00000000")
    assert laboratory.failed("SDO download") == [
        ("7.2.4.3.17", "fewer bytes than announced abort with 0607 0010h or 0013h")
    ]


def test_a_number_shorter_than_announced_is_taken(laboratory):
    # What is missing in a segment, the last, of one byte, is taken as zero.
    laboratory.hears = begun_otherwise(REQUEST, "0d", "0b")
    assert (
        "7.2.4.3.17",
        "fewer bytes than announced abort with 0607 0010h or 0013h",
    ) in laboratory.failed("SDO download")


def test_a_node_that_does_not_start_by_itself(make_variant):
    laboratory = make_variant(startup=4)

    def says(frame):
        if frame.can_id == 0x705 and frame.data == b"\0":
            laboratory.hears = stays
        return [frame]

    def stays(frame):
        """After a boot-up, the first that comes finds the node in PRE-OPERATIONAL."""
        laboratory.hears = lambda frame: [frame]
        return [Frame(0x000, b"\x80\x05"), frame]

    laboratory.says = says
    assert laboratory.failed("Store and restore") == [
        ("CiA 302-2, 1F80h", "with bit 2 clear and stored, the node starts by itself")
    ]


def test_a_node_that_starts_though_told_not_to(make_variant):
    laboratory = make_variant(startup=4)
    laboratory.hears = begun_otherwise(REQUEST, "23801f00", "23801f00 00000000")
    assert laboratory.failed("Store and restore") == [
        ("CiA 302-2, 1F80h", "with bit 2 clear and stored, the node starts by itself")
    ]


def test_an_sdo_server_that_is_mute_before_its_first_transfer(laboratory):
    is_fresh = True

    def hears(frame):
        nonlocal is_fresh
        if frame.can_id == 0x000 and frame.data[:1] in {b"\x81", b"\x82"}:
            is_fresh = True
        if frame.can_id == 0x605 and frame.data[:1] in {b"\x40", b"\x23", b"\x2b"}:
            is_fresh = False
        return [] if is_fresh and frame.can_id == 0x605 else [frame]

    laboratory.hears = hears
    assert laboratory.failed("SDO upload") == [
        ("7.2.4.3.17", "the first request after a reset aborts likewise")
    ]


def test_sdo_that_is_served_in_stopped(laboratory):
    """The node leaves STOPPED for the time of a request."""
    is_stopped = False

    def hears(frame):
        nonlocal is_stopped
        if frame.can_id == 0x000:
            is_stopped = frame.data[:1] == b"\x02"
        if frame.can_id == 0x605 and is_stopped:
            return [Frame(0x000, b"\x80\x05"), frame]
        return [frame]

    laboratory.hears = hears
    assert ("7.3.2.3", "STOPPED has no SDO; leaving it brings SDO back") in laboratory.failed("NMT")


@pytest.mark.parametrize(
    ("code", "outcome"),
    [
        (0x05040001, Outcome.NOT_APPLICABLE),  # no such command
        (0x06010000, Outcome.NOT_APPLICABLE),  # no such access
        (0x08000000, Outcome.FAILED),
    ],
)
def test_a_server_without_block_transfer_has_nothing_to_judge(laboratory, code, outcome):
    def hears(frame):
        is_block = frame.can_id == 0x605 and frame.data[0] >> 5 in {5, 6}
        return [frame._replace(data=b"\xe0" + frame.data[1:])] if is_block else [frame]

    laboratory.hears, laboratory.says = hears, aborted_otherwise(code, 0x05040001)
    assert outcome in {result.outcome for result in laboratory.run("SDO block transfer")}
    assert bool(laboratory.failed("SDO block transfer")) == (outcome is Outcome.FAILED)


def test_a_missing_boot_up_is_one_finding(laboratory):
    laboratory.says = lost(HEARTBEAT, "00")
    assert laboratory.failed() == [
        ("7.2.8.3.3", "reset node is followed by the boot-up message"),
        ("7.2.8.3.3", "reset communication is followed by the boot-up message"),
    ]


@pytest.mark.parametrize(
    "key",
    [(0x1005, 0), (0x1014, 0), (0x1016, 1), (0x1017, 0), (0x1400, 1), (0x1800, 1)],
)
def test_what_a_reset_of_communication_does_not_restore(laboratory, key):
    """7.3.2.2.1: it sets the parameters of the communication profile to their power-on values."""
    variable = laboratory.node.object_dictionary.variable(*key)

    def hears(frame):
        if frame.can_id == 0 and frame.data[:1] == b"\x82":
            laboratory.says = keeps(variable.value)
        return [frame]

    def keeps(value):
        def says(frame):
            if frame.can_id == HEARTBEAT and frame.data == b"\0":
                variable.value = value
            return [frame]

        return says

    laboratory.hears = hears
    (failed,) = [r for r in laboratory.run("NMT") if r.outcome is Outcome.FAILED]
    assert failed.check.clause == "7.3.2.2.1"
    assert failed.detail.startswith(f"0x{key[0]:04X}.{key[1]:02X} is ")
    assert variable.value == variable.default


@pytest.fixture
def two_rpdos(make_laboratory, eds_path, tmp_path):
    """A device whose RPDOs 0x205 and 0x305 both carry 0x2000 and 0x2001."""
    text = eds_path.read_text(encoding="utf-8")
    for own, of_the_first in (("0x20020018", "0x20000010"), ("0x20030001", "0x20010010")):
        text = text.replace(f"DefaultValue={own}", f"DefaultValue={of_the_first}")
    path = tmp_path / "two.eds"
    path.write_text(text, encoding="utf-8")
    return make_laboratory(path)


def test_each_rpdo_is_judged(two_rpdos):
    """The device does not hear the second."""
    laboratory = two_rpdos
    assert laboratory.result("RPDO", "an asynchronous RPDO acts at once") == (
        Outcome.PASSED,
        "1400h 4 bytes; 1401h 4 bytes",
    )
    _, short = laboratory.result("RPDO", "an RPDO that is too short")
    assert short == "1400h EMCY 8210h; 1401h EMCY 8210h"
    laboratory.hears = lost(0x305)
    outcome, detail = laboratory.result("RPDO", "an asynchronous RPDO acts at once")
    assert outcome is Outcome.FAILED
    assert detail.startswith("1401h: after an RPDO its objects hold 00 00 00 00")


def test_an_emcy_that_came_need_not_come_again(two_rpdos):
    """A device may keep a communication error until a reset (7.2.7.1)."""
    laboratory, seen = two_rpdos, []

    def says(frame):
        if frame.can_id != 0x085 or frame.data[:2] != b"\x10\x82":
            return [frame]
        seen.append(frame)
        return [frame] if len(seen) == 1 else []

    laboratory.says = says
    assert laboratory.result("RPDO", "an RPDO that is too short") == (
        Outcome.PASSED,
        "1400h EMCY 8210h; 1401h no further EMCY 8210h",
    )


def test_a_heartbeat_time_of_which_one_byte_counts(laboratory):
    """300 ms is 012Ch, of which 2Ch are 44 ms."""
    laboratory.hears = begun_otherwise(REQUEST, "2b171000 2c01", "2b171000 2c00")
    outcome, detail = laboratory.result("Error control", "the heartbeat has the period of 1017h")
    assert (outcome, detail) == (Outcome.FAILED, "period 44.0 ms; 300 ms is right")


def test_answers_that_come_late_are_no_answers_to_later_requests(laboratory):
    """Each comes 0.7 s after its request; 0.5 s is the patience."""
    waiting = []

    def beside(frames):
        now = laboratory.bus.now()
        waiting.extend((now + 0.7, frame) for frame in frames if frame.can_id == 0x585)
        due = [frame for time, frame in waiting if time <= now]
        del waiting[: len(due)]
        return [*(frame for frame in frames if frame.can_id != 0x585), *due]

    laboratory.beside = beside
    results = laboratory.run("Object dictionary", "Error control")
    failed = [result.detail for result in results if result.outcome is Outcome.FAILED]
    assert len(failed) > 5
    for detail in failed:
        assert ": no answer within 0.5 s; an answer came 0.7" in detail
        assert detail.endswith(" s after its request: see --patience")
