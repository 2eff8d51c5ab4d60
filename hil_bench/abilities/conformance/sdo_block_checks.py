"""SDO block transfer (CiA 301, 7.2.4.3.8 to 7.2.4.3.16); a device need not have it."""

from binascii import crc_hqx

from hil_bench.abilities.conformance.check import Chapter, Impact
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.scratch import (
    expect_text,
    long_scratch,
    scratch,
    unchanged,
    write_what_fits,
)
from hil_bench.abilities.conformance.sdo_block_client import UNSUPPORTED, BlockDownload, BlockUpload
from hil_bench.abilities.conformance.sdo_client import code_text, shown
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable

_NOTHING_CONFIRMED = b"\xa2\x00"
"""Of a sub-block: all its segments are to be sent again (CiA 301, 7.2.4.3.10, ackseq 0)."""

CHAPTER = Chapter("SDO block transfer")

_SPECIFIER, _BLOCK_SIZE, _SEQUENCE, _CRC = 0x05040001, 0x05040002, 0x05040003, 0x05040004
_SHORT = (0x06070010, 0x06070012, 0x06070013, _SPECIFIER)
_SEGMENT = 7

_DATA = bytes(number * 7 % 95 + 32 for number in range(100))
"""Printable, of 15 segments, the last of 2 bytes."""


@CHAPTER.check("7.2.4.3.13", "a block upload brings the same bytes, with the right CRC")
def upload(dut: DeviceUnderTest) -> str:
    """Upload the longest object in the largest sub-blocks."""
    client = BlockUpload(dut)
    data = client.run([127])
    _expect_same(dut, client, data)
    return f"{client.name}, {len(data)} bytes, {'with' if client.has_crc else 'without'} CRC"


@CHAPTER.check("7.2.4.3.14", "the client may change the block size with each confirmation")
def block_size_change(dut: DeviceUnderTest) -> None:
    """Upload in sub-blocks of one, two and three segments."""
    client = BlockUpload(dut)
    _expect_same(dut, client, client.run([1, 2, 3, 127]))


@CHAPTER.check("7.2.4.3.14", "segments that the client has missed are sent again")
def lost_segments(dut: DeviceUnderTest) -> None:
    """Confirm nothing the first time, then one segment fewer than came."""
    client = BlockUpload(dut)
    _expect_same(dut, client, client.run([127], lost=[127, 1]))


@CHAPTER.check("7.2.4.3.13", "a block size of 0 or 128 aborts with 0504 0002h")
def wrong_block_size(dut: DeviceUnderTest) -> None:
    """Begin two uploads with impossible sub-blocks."""
    client = BlockUpload(dut)
    for size in (0, 128):
        dut.sdo.expect_abort(client.request(size), _BLOCK_SIZE)


@CHAPTER.check(
    "7.2.4.3.14", "confirming a segment that was not sent aborts, or confirms what was sent"
)
def sequence_beyond(dut: DeviceUnderTest) -> str:
    """Confirm segment 127 of a sub-block of one; no clause says what is right then."""
    client = BlockUpload(dut)
    plain = dut.sdo.upload(*client.key)
    client.begin(1)
    client.sub_block(1)
    request = bytes([0xA2, 127, 1, *bytes(5)])
    answer = dut.sdo.exchange(request)
    following = plain[_SEGMENT : 2 * _SEGMENT]
    if following and answer[0] & 0x7F == 1 and answer[1:].startswith(following):
        dut.sdo.abort()
        return "goes on behind what was sent"
    return code_text(dut.sdo.judge_abort(request, answer, (_SEQUENCE, _SPECIFIER)))


@CHAPTER.check("7.2.4.3.17", "an abort ends a block upload without an answer")
def upload_abort(dut: DeviceUnderTest) -> None:
    """Abort after the initiation, then ask for a start."""
    client = BlockUpload(dut)
    dut.sdo.exchange(client.request(127))
    dut.sdo.expect_silence(dut.sdo.abort_request())
    dut.sdo.expect_abort(bytes([0xA3, *bytes(7)]), _SPECIFIER)


@CHAPTER.check("7.2.4.3.13", "a plain upload takes its place up to the threshold only")
def protocol_switch(dut: DeviceUnderTest) -> str:
    """Begin block uploads of 1000h with the thresholds 0 (none) and four bytes."""
    request = bytes([0xA4, 0x00, 0x10, 0, 127, 0, 0, 0])
    answer = dut.sdo.exchange(request)
    dut.sdo.abort()
    if answer[0] == 0x80:
        dut.sdo.judge_abort(request, answer, UNSUPPORTED)
        raise NotApplicable("the device has no block upload")
    if answer[0] >> 5 != 6:
        raise Deviation(f"{shown(request)}: answer {shown(answer)}; C6 or C2 ... is right")
    request = bytes([0xA4, 0x00, 0x10, 0, 127, 4, 0, 0])
    answer = dut.sdo.exchange(request)
    dut.sdo.abort()
    if answer[0] >> 5 == 2 and answer[1:4] == request[1:4]:
        return "switches"
    if answer[0] >> 5 == 6:
        return "goes on as block upload"
    raise Deviation(f"{shown(request)}: answer {shown(answer)}; 43 ... or C6 ... is right")


@CHAPTER.check("7.2.4.3.9", "a block download with CRC is taken and read back", Impact.WRITE)
def download(dut: DeviceUnderTest) -> str:
    """Write a long object, as much as it takes."""
    with long_scratch(dut) as variable:
        client = BlockDownload(dut, (variable.index, variable.subindex))
        raw = write_what_fits(dut, variable, _DATA, client.run)
        expect_text(dut, variable, raw)
        return f"{client.name}, {len(raw)} bytes, sub-blocks of {client.block_size}"


@CHAPTER.check("7.2.4.3.10", "after a lost segment the rest is asked for again", Impact.WRITE)
def download_lost(dut: DeviceUnderTest) -> None:
    """Leave out the third segment of a sub-block once, or the last one of fewer."""
    with long_scratch(dut) as variable:
        client = BlockDownload(dut, (variable.index, variable.subindex))
        raw = write_what_fits(dut, variable, _DATA, lambda raw: client.run(raw, leave_out=3))
        expect_text(dut, variable, raw)


@CHAPTER.check("7.2.4.3.16", "a wrong CRC aborts with 0504 0004h and changes nothing", Impact.WRITE)
def wrong_crc(dut: DeviceUnderTest) -> None:
    """Write a number with one bit of its CRC wrong."""
    with scratch(dut) as variable, unchanged(dut, variable):
        client = BlockDownload(dut, (variable.index, variable.subindex))
        if not client.begin(variable.data_type.size):
            raise NotApplicable("the device takes no CRC")
        raw = bytes([7, *bytes(variable.data_type.size - 1)])
        client.send_all(raw)
        dut.sdo.expect_abort(client.end_request(raw, crc_hqx(raw, 0) ^ 1), _CRC)


@CHAPTER.check("7.2.4.3.11", "fewer bytes than announced abort", Impact.WRITE)
def shorter_than_announced(dut: DeviceUnderTest) -> str:
    """End a block download one byte short; the object keeps its value, no clause names the code."""
    with scratch(dut) as variable, unchanged(dut, variable):
        client = BlockDownload(dut, (variable.index, variable.subindex))
        client.begin(variable.data_type.size)
        raw = bytes(variable.data_type.size - 1)
        client.send_all(raw)
        return code_text(dut.sdo.expect_abort(client.end_request(raw, crc_hqx(raw, 0)), *_SHORT))


@CHAPTER.check(
    "7.2.4.3.10", "segment number 0 aborts with 0504 0003h, or counts for nothing", Impact.WRITE
)
def segment_zero(dut: DeviceUnderTest) -> None:
    """Send a segment without a number, then abort: the device may still wait for the first.

    It may also ask for the first again when its own time has passed (a confirmation of number 0).
    """
    with scratch(dut) as variable, unchanged(dut, variable):
        client = BlockDownload(dut, (variable.index, variable.subindex))
        client.begin(variable.data_type.size)
        request = bytes(8)
        dut.sdo.send(request)
        answer = dut.sdo.answer()
        dut.sdo.abort()
        if answer is not None and answer[:2] != _NOTHING_CONFIRMED:
            dut.sdo.judge_abort(request, answer, (_SEQUENCE, _SPECIFIER))


@CHAPTER.check("7.2.4.3.17", "an aborted block download changes nothing", Impact.WRITE)
def download_abort(dut: DeviceUnderTest) -> None:
    """Abort after the last segment."""
    with scratch(dut) as variable, unchanged(dut, variable):
        client = BlockDownload(dut, (variable.index, variable.subindex))
        client.begin(variable.data_type.size)
        raw = b"\x07".ljust(variable.data_type.size, b"\0")
        client.send_all(raw)
        dut.sdo.expect_silence(dut.sdo.abort_request())


def _expect_same(dut: DeviceUnderTest, client: BlockUpload, data: bytes) -> None:
    plain = dut.sdo.upload(*client.key)
    if data != plain:
        raise Deviation(f"{client.name}: {len(data)} bytes, other than by a plain upload")
