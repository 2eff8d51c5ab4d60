"""SDO block transfer: a client that can do wrong, and what it checks."""

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
from hil_bench.abilities.conformance.sdo_checks import long_object
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable, Refused
from hil_bench.abilities.conformance.wire import Bounds, code_text, shown, wrong
from hil_bench.config.objects import name_object

# The client side of SDO block transfers, which can also get them wrong (CiA 301, 7.2.4.3.8).


UNSUPPORTED = (0x05040001, 0x06010000)
"""Aborts by which a device says that it has no block transfer."""


class BlockUpload:
    """The client side of a block upload of the longest object.

    Raises:
        NotApplicable: the device has no block upload, or nothing to upload.
    """

    def __init__(self, dut: DeviceUnderTest) -> None:
        self._dut = dut
        self.key = 0x1000, 0
        answer = dut.sdo.exchange(self.request(127))
        dut.sdo.abort()
        if answer[0] == 0x80:
            dut.sdo.judge_abort(self.request(127), answer, UNSUPPORTED)
            raise NotApplicable("the device has no block upload")
        if answer[0] >> 5 == 2:
            raise NotApplicable("the device answers a block upload by a plain one")
        self.key = long_object(dut)[:2]
        self.name = name_object(*self.key)
        self.has_crc = False
        self.size: int | None = None

    def request(self, block_size: int) -> bytes:
        """Return the first request; a client that can check CRCs, no threshold."""
        index, subindex = self.key
        return bytes([0xA4, index & 0xFF, index >> 8, subindex, block_size, 0, 0, 0])

    def begin(self, block_size: int) -> None:
        """Initiate and start.

        Raises:
            Deviation: the answer is none of a block upload.
        """
        request = self.request(block_size)
        answer = self._dut.sdo.exchange(request)
        if answer[0] & 0xF9 != 0xC0 or answer[1:4] != request[1:4]:
            raise Deviation(wrong(request, answer, "C6 or C2 ... is right"))
        self.has_crc = bool(answer[0] & 4)
        self.size = int.from_bytes(answer[4:], "little") if answer[0] & 2 else None
        self._dut.sdo.send(bytes([0xA3, *bytes(7)]))

    def run(self, block_sizes: list[int], lost: list[int] | None = None) -> bytes:
        """Return the data of a whole upload.

        Args:
            block_sizes: of one sub-block after the other; the last goes on.
            lost: how many segments of each of the first sub-blocks are not confirmed.
        """
        sizes, missing = list(block_sizes), list(lost or ())
        self.begin(sizes[0])
        data = bytearray()
        is_over = False
        # The last segment is padded, and what was not confirmed comes again.
        bounds = Bounds(self._dut.wire, None if self.size is None else self.size + 7)
        while not is_over:
            bounds.check(len(data))
            segments, is_over = self.sub_block(sizes.pop(0) if len(sizes) > 1 else sizes[0])
            if missing and (drop := min(missing.pop(0), len(segments))):
                del segments[-drop:]
                is_over = False
            data += b"".join(segments)
            self._dut.sdo.send(bytes([0xA2, len(segments), sizes[0], *bytes(5)]))
        return self._finish(data)

    def sub_block(self, block_size: int) -> tuple[list[bytes], bool]:
        """Return the segments of a sub-block, and whether the last one of all was among them.

        Raises:
            Deviation: a segment is missing, or has a wrong number.
        """
        segments: list[bytes] = []
        for number in range(1, block_size + 1):
            segment = self._dut.sdo.answer()
            if segment is None or len(segment) != 8:
                raise Deviation(f"segment {number} of a sub-block of {block_size} did not come")
            if segment[0] & 0x7F != number:
                raise Deviation(f"segment {shown(segment)}; number {number} is right")
            segments.append(segment[1:])
            if segment[0] & 0x80:
                return segments, True
        return segments, False

    def _finish(self, data: bytearray) -> bytes:
        answer = self._dut.sdo.answer()
        if answer is None or answer[0] & 0xE3 != 0xC1:
            raise Deviation(f"end {shown(answer or b'')}; C1 ... is right")
        whole = bytes(data[: len(data) - (answer[0] >> 2 & 7)])
        crc = int.from_bytes(answer[1:3], "little")
        self._dut.sdo.send(bytes([0xA1, *bytes(7)]))
        if self.has_crc and crc != crc_hqx(whole, 0):
            raise Deviation(f"CRC {crc:04X}h; {crc_hqx(whole, 0):04X}h is right (7.2.4.3.16)")
        if self.size is not None and self.size != len(whole):
            raise Deviation(f"{self.size} bytes announced, {len(whole)} came")
        return whole


class BlockDownload:
    """The client side of a block download.

    Attributes:
        name: the object.
        block_size: segments that the device takes in a sub-block at present.
    """

    def __init__(self, dut: DeviceUnderTest, key: tuple[int, int]) -> None:
        self.name = name_object(*key)
        self.block_size = 0
        self._dut = dut
        self._key = key

    def begin(self, size: int) -> bool:
        """Initiate; return whether the device checks the CRC.

        Raises:
            Deviation: the answer is wrong.
        """
        index, subindex = self._key
        request = bytes([0xC6, index & 0xFF, index >> 8, subindex]) + size.to_bytes(4, "little")
        answer = self._dut.sdo.exchange(request)
        self._check_abort(answer)
        if answer[0] & 0xFB != 0xA0 or answer[1:4] != request[1:4] or not 1 <= answer[4] <= 127:
            raise Deviation(wrong(request, answer, "A4 or A0 ... is right"))
        self.block_size = answer[4]
        return bool(answer[0] & 4)

    def run(self, data: bytes, *, leave_out: int = 0) -> None:
        """Write all, as `send_all` does, with the right CRC."""
        self.begin(len(data))
        self.send_all(data, leave_out=min(leave_out, -(-len(data) // 7)))
        self.end(data)

    def send_all(self, data: bytes, *, leave_out: int = 0) -> None:
        """Send all segments, sub-block by sub-block.

        Args:
            data: the bytes.
            leave_out: number of the segment that gets lost the first time, 0 for none.
        """
        chunks = [data[start : start + 7].ljust(7, b"\0") for start in range(0, len(data), 7)]
        done = 0
        while done < len(chunks):
            sent = chunks[done : done + self.block_size]
            for number, chunk in enumerate(sent, start=1):
                is_last = done + number == len(chunks)
                if number != leave_out:
                    self._dut.sdo.send(bytes([number | is_last << 7]) + chunk)
            done += self._confirmed(leave_out - 1 if 0 < leave_out <= len(sent) else len(sent))
            leave_out = 0

    def end(self, data: bytes) -> None:
        """End with the right CRC.

        Raises:
            Deviation: the answer is wrong.
        """
        answer = self._dut.sdo.exchange(self.end_request(data, crc_hqx(data, 0)))
        self._check_abort(answer)
        if answer[0] != 0xA1:
            raise Deviation(f"end of the download: answer {shown(answer)}; A1 is right")

    def end_request(self, data: bytes, crc: int) -> bytes:
        """Return the last request."""
        unused = -len(data) % 7
        return bytes([0xC1 | unused << 2]) + crc.to_bytes(2, "little") + bytes(5)

    def _check_abort(self, answer: bytes | None) -> None:
        """Tell an abort that should not be.

        Raises:
            NotApplicable: the device has no block download.
            Refused: it is another one.
        """
        if answer is None or answer[0] != 0x80:
            return
        code = int.from_bytes(answer[4:], "little")
        if code in UNSUPPORTED:
            raise NotApplicable("the device has no block download")
        raise Refused(f"{self.name}: abort {code_text(code)}", code)

    def _confirmed(self, right: int) -> int:
        # Half a transfer's time-out may pass until a device misses the end of a sub-block.
        answer = self._dut.sdo.answer(timeout=2.0 + self._dut.patience)
        self._check_abort(answer)
        if answer is None or answer[0] != 0xA2 or not 1 <= answer[2] <= 127:
            raise Deviation(f"confirmation {shown(answer or b'')}; A2 ... is right")
        if answer[1] != right:
            raise Deviation(f"segment {answer[1]} is confirmed; {right} is right")
        self.block_size = answer[2]
        return right


# SDO block transfer (CiA 301, 7.2.4.3.8 to 7.2.4.3.16); a device need not have it.


_NOTHING_CONFIRMED = b"\xa2\x00"
"""Of a sub-block: all its segments are to be sent again (CiA 301, 7.2.4.3.10, ackseq 0)."""

BLOCKS = Chapter("SDO block transfer", impact=Impact.READ)

_SPECIFIER, _BLOCK_SIZE, _SEQUENCE, _CRC = 0x05040001, 0x05040002, 0x05040003, 0x05040004
_SHORT = (0x06070010, 0x06070012, 0x06070013, _SPECIFIER)
_SEGMENT = 7

_DATA = bytes(number * 7 % 95 + 32 for number in range(100))
"""Printable, of 15 segments, the last of 2 bytes."""


@BLOCKS.check("7.2.4.3.13", "a block upload brings the same bytes, with the right CRC")
def upload(dut: DeviceUnderTest) -> str:
    """Upload the longest object in the largest sub-blocks."""
    client = BlockUpload(dut)
    data = client.run([127])
    _expect_same(dut, client, data)
    return f"{client.name}, {len(data)} bytes, {'with' if client.has_crc else 'without'} CRC"


@BLOCKS.check("7.2.4.3.14", "the client may change the block size with each confirmation")
def block_size_change(dut: DeviceUnderTest) -> None:
    """Upload in sub-blocks of one, two and three segments."""
    client = BlockUpload(dut)
    _expect_same(dut, client, client.run([1, 2, 3, 127]))


@BLOCKS.check("7.2.4.3.14", "segments that the client has missed are sent again")
def lost_segments(dut: DeviceUnderTest) -> None:
    """Confirm nothing the first time, then one segment fewer than came."""
    client = BlockUpload(dut)
    _expect_same(dut, client, client.run([127], lost=[127, 1]))


@BLOCKS.check("7.2.4.3.13", "a block size of 0 or 128 aborts with 0504 0002h")
def wrong_block_size(dut: DeviceUnderTest) -> None:
    """Begin two uploads with impossible sub-blocks."""
    client = BlockUpload(dut)
    for size in (0, 128):
        dut.sdo.expect_abort(client.request(size), _BLOCK_SIZE)


@BLOCKS.check(
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


@BLOCKS.check("7.2.4.3.17", "an abort ends a block upload without an answer")
def upload_abort(dut: DeviceUnderTest) -> None:
    """Abort after the initiation, then ask for a start."""
    client = BlockUpload(dut)
    dut.sdo.exchange(client.request(127))
    dut.sdo.expect_silence(dut.sdo.abort_request())
    dut.sdo.expect_abort(bytes([0xA3, *bytes(7)]), _SPECIFIER)


@BLOCKS.check("7.2.4.3.13", "a plain upload takes its place up to the threshold only")
def protocol_switch(dut: DeviceUnderTest) -> str:
    """Begin block uploads of 1000h with the thresholds 0 (none) and four bytes."""
    request = bytes([0xA4, 0x00, 0x10, 0, 127, 0, 0, 0])
    answer = dut.sdo.exchange(request)
    dut.sdo.abort()
    if answer[0] == 0x80:
        dut.sdo.judge_abort(request, answer, UNSUPPORTED)
        raise NotApplicable("the device has no block upload")
    if answer[0] >> 5 != 6:
        raise Deviation(wrong(request, answer, "C6 or C2 ... is right"))
    request = bytes([0xA4, 0x00, 0x10, 0, 127, 4, 0, 0])
    answer = dut.sdo.exchange(request)
    dut.sdo.abort()
    if answer[0] >> 5 == 2 and answer[1:4] == request[1:4]:
        return "switches"
    if answer[0] >> 5 == 6:
        return "goes on as block upload"
    raise Deviation(wrong(request, answer, "43 ... or C6 ... is right"))


@BLOCKS.check("7.2.4.3.9", "a block download with CRC is taken and read back", Impact.WRITE)
def download(dut: DeviceUnderTest) -> str:
    """Write a long object, as much as it takes."""
    with long_scratch(dut) as variable:
        client = BlockDownload(dut, variable.key)
        raw = write_what_fits(dut, variable, _DATA, client.run)
        expect_text(dut, variable, raw)
        return f"{client.name}, {len(raw)} bytes, sub-blocks of {client.block_size}"


@BLOCKS.check("7.2.4.3.10", "after a lost segment the rest is asked for again", Impact.WRITE)
def download_lost(dut: DeviceUnderTest) -> None:
    """Leave out the third segment of a sub-block once, or the last one of fewer."""
    with long_scratch(dut) as variable:
        client = BlockDownload(dut, variable.key)
        raw = write_what_fits(dut, variable, _DATA, lambda raw: client.run(raw, leave_out=3))
        expect_text(dut, variable, raw)


@BLOCKS.check("7.2.4.3.16", "a wrong CRC aborts with 0504 0004h and changes nothing", Impact.WRITE)
def wrong_crc(dut: DeviceUnderTest) -> None:
    """Write a number with one bit of its CRC wrong."""
    with scratch(dut) as variable, unchanged(dut, variable):
        client = BlockDownload(dut, variable.key)
        if not client.begin(variable.data_type.size):
            raise NotApplicable("the device takes no CRC")
        raw = bytes([7, *bytes(variable.data_type.size - 1)])
        client.send_all(raw)
        dut.sdo.expect_abort(client.end_request(raw, crc_hqx(raw, 0) ^ 1), _CRC)


@BLOCKS.check("7.2.4.3.11", "fewer bytes than announced abort", Impact.WRITE)
def shorter_than_announced(dut: DeviceUnderTest) -> str:
    """End a block download one byte short; the object keeps its value, no clause names the code."""
    with scratch(dut) as variable, unchanged(dut, variable):
        client = BlockDownload(dut, variable.key)
        client.begin(variable.data_type.size)
        raw = bytes(variable.data_type.size - 1)
        client.send_all(raw)
        return code_text(dut.sdo.expect_abort(client.end_request(raw, crc_hqx(raw, 0)), *_SHORT))


@BLOCKS.check(
    "7.2.4.3.10", "segment number 0 aborts with 0504 0003h, or counts for nothing", Impact.WRITE
)
def segment_zero(dut: DeviceUnderTest) -> None:
    """Send a segment without a number, then abort: the device may still wait for the first.

    It may also ask for the first again when its own time has passed (a confirmation of number 0).
    """
    with scratch(dut) as variable, unchanged(dut, variable):
        client = BlockDownload(dut, variable.key)
        client.begin(variable.data_type.size)
        request = bytes(8)
        dut.sdo.send(request)
        answer = dut.sdo.answer()
        dut.sdo.abort()
        if answer is not None and answer[:2] != _NOTHING_CONFIRMED:
            dut.sdo.judge_abort(request, answer, (_SEQUENCE, _SPECIFIER))


@BLOCKS.check("7.2.4.3.17", "an aborted block download changes nothing", Impact.WRITE)
def download_abort(dut: DeviceUnderTest) -> None:
    """Abort after the last segment."""
    with scratch(dut) as variable, unchanged(dut, variable):
        client = BlockDownload(dut, variable.key)
        client.begin(variable.data_type.size)
        raw = b"\x07".ljust(variable.data_type.size, b"\0")
        client.send_all(raw)
        dut.sdo.expect_silence(dut.sdo.abort_request())


def _expect_same(dut: DeviceUnderTest, client: BlockUpload, data: bytes) -> None:
    plain = dut.sdo.upload(*client.key)
    if data != plain:
        raise Deviation(f"{client.name}: {len(data)} bytes, other than by a plain upload")
