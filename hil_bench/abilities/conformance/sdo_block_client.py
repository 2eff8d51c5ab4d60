"""The client side of SDO block transfers, which can also get them wrong (CiA 301, 7.2.4.3.8)."""

from binascii import crc_hqx

from hil_bench.abilities.conformance.device import DeviceUnderTest, place
from hil_bench.abilities.conformance.sdo_client import Bounds, code_text, shown
from hil_bench.abilities.conformance.sdo_upload_checks import long_object
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable, Refused

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
        self.name = place(*self.key)
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
            raise Deviation(f"{shown(request)}: answer {shown(answer)}; C6 or C2 ... is right")
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
        self.name = place(*key)
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
            raise Deviation(f"{shown(request)}: answer {shown(answer)}; A4 or A0 ... is right")
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
