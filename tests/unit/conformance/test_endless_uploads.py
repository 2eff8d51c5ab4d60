"""Devices whose uploads have no end: the suite's own client says so, and goes on."""

import pytest

from hil_bench.abilities.conformance.sdo_block_checks import BlockUpload
from hil_bench.abilities.conformance.verdicts import Deviation
from hil_bench.abilities.conformance.wire import MOST_BYTES

TEXT = (0x2020, 0)  # VISIBLE_STRING "abc"


def endless(announced=None, segment=b"abcdefg"):
    """Says segments for ever where the node says the end of an upload, or what is announced."""

    def says(frame):
        if frame.can_id != 0x585:
            return [frame]
        specifier = frame.data[0] >> 5
        if specifier == 2:  # the upload is initiated: segments follow
            head = 0x40 if announced is None else 0x41
            size = (announced or 0).to_bytes(4, "little")
            return [frame._replace(data=bytes([head]) + frame.data[1:4] + size)]
        toggle = says.toggle
        says.toggle ^= 0x10
        command = toggle | (7 - len(segment)) << 1
        return [frame._replace(data=bytes([command]) + segment.ljust(7, b"\0"))]

    says.toggle = 0
    return says


@pytest.mark.parametrize(
    ("announced", "segment", "told"),
    [
        (None, b"abcdefg", f"more than {MOST_BYTES} bytes came, and no last segment"),
        (20, b"abcdefg", "20 bytes announced; more than 20 bytes came, and no last segment"),
        (20, b"", "20 bytes announced; more than 20 bytes came, and no last segment"),
    ],
)
def test_an_upload_without_end_breaks_its_clause(laboratory, announced, segment, told):
    laboratory.says = endless(announced, segment)
    with pytest.raises(Deviation, match=f"^{told}$"):
        laboratory.dut.sdo.upload(*TEXT)


def test_one_that_is_slow_beyond_all_bounds_too(laboratory, monkeypatch):
    monkeypatch.setattr("hil_bench.abilities.conformance.wire.LONGEST_TRANSFER", 0.05)
    laboratory.says = endless()
    with pytest.raises(Deviation, match=r"^no last segment within 0\.05 s$"):
        laboratory.dut.sdo.upload(*TEXT)


def test_a_block_upload_without_end_likewise(laboratory):
    upload = BlockUpload(laboratory.dut)
    said = []

    def says(frame):
        """After the first answer, all that comes is segment 1 of yet another sub-block."""
        said.append(frame)
        return [frame] if len(said) == 1 else [frame._replace(data=b"\x01abcdefg")]

    laboratory.says = says
    with pytest.raises(Deviation, match="bytes came, and no last segment"):
        upload.run([1])


def test_a_server_that_answers_without_end_breaks_the_burst(laboratory):
    laboratory.says = lambda frame: [frame] * 50 if frame.can_id == 0x585 else [frame]
    assert "burst" in laboratory.failed_checks("SDO upload")
