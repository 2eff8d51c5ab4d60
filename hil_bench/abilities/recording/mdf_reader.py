"""Reads the MF4 files that `mdf_writer` writes; other tools' files have other layouts.

Whatever an address or a length says is checked before it is used: a file may be damaged or made up.
"""

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.recording import mdf_blocks as mdf
from hil_bench.canopen_device.frame import BRS, ESI, FDF, Frame
from hil_bench.errors import ConfigError, about_file
from hil_bench.frame import ERROR_FLAG, FD_LENGTHS
from hil_bench.outside.recording.channels import (
    TIME,
    Channel,
    LoggedFrame,
    Recording,
    recording_dtype,
)

_MOST_CHANNELS = 10_000
_LARGEST = 1 << 30
"""All data of a file, unpacked [byte]: an hour of 37 signals each millisecond."""

_RECORDS = {
    mdf.DATA_FRAME: mdf.DATA_RECORD,
    mdf.REMOTE_FRAME: mdf.REMOTE_RECORD,
    mdf.ERROR_FRAME: mdf.ERROR_RECORD,
}
_LINKS = {b"##HD": 1, b"##DG": 3, b"##CG": 2, b"##CN": 7, b"##HL": 1, b"##DL": 1}
"""Links that are followed, and so must be there, of each kind of block."""


class MdfContent(NamedTuple):
    """The content of an MF4 file.

    Attributes:
        signals: the signals; without rows where there are none.
        frames: the frames in the order of time.
    """

    signals: Recording
    frames: list[LoggedFrame]


def read_mdf(path: Path) -> MdfContent:
    """Read the content of an MF4 file.

    Raises:
        ConfigError: it cannot be read.
        ForeignMdfError: it is no MF4 of ours.
    """
    with about_file(path, what="cannot be read", right="give a recording"):
        content = path.read_bytes()
    try:
        return _Reader(content).read()
    except _CutOffError:
        raise ConfigError(
            f"{path}: is cut off or damaged: it ends after {len(content)} bytes, where a block "
            "should be; give the whole recording"
        ) from None
    except zlib.error as error:
        raise ConfigError(
            f"{path}: is cut off or damaged: a block of its data does not unpack ({error}); "
            "give the recording as it was written"
        ) from None
    except (ValueError, struct.error, OverflowError) as error:
        raise ForeignMdfError(path, str(error)) from None


class ForeignMdfError(ConfigError):
    """The file is no MF4 of ours: of another tool, or none at all.

    Args:
        path: the file.
        reason: by what that shows.

    Attributes:
        words: that it is none of ours, in a sentence.
    """

    def __init__(self, path: Path, reason: str) -> None:
        self.words = f"{path}: is no recording of hil-bench: {reason}"
        super().__init__(f"{self.words}; of other MF4, export the signals as CSV, as asammdf does")


class _CutOffError(Exception):
    """The file ends where a block should be."""


class _Reader:
    """The content of a file as blocks."""

    def __init__(self, content: bytes) -> None:
        self._content = content
        self._unfolded = 0

    def read(self) -> MdfContent:
        """Return the content of the file.

        Raises:
            ValueError: it is no file of ours.
        """
        if not self._content.startswith(b"MDF     4."):
            raise ValueError("it does not begin as MDF 4")
        signals: Recording | None = None
        frames: list[LoggedFrame] = []
        for group in self._chain(self._block(mdf.IDENTIFICATION_SIZE, b"##HD").links[0], b"##DG"):
            cg = self._block(group.links[1], b"##CG")
            _, _, flags, _, _, size, _ = mdf.CG_DATA.unpack_from(cg.data)
            if flags & mdf.BUS_EVENT:
                frames += self._frames(cg, group.links[2], size)
            elif signals is not None:
                raise ValueError("it has several groups of signals")
            else:
                channels = self._channels(cg.links[1], size)
                dtype = recording_dtype(channels)
                signals = self._records(group.links[2], dtype)
        frames.sort(key=lambda logged: logged.now)
        nothing = np.zeros(0, dtype=recording_dtype([TIME]))
        return MdfContent(nothing if signals is None else signals, frames)

    def _channels(self, address: int, size: int) -> list[Channel]:
        channels = []
        for number, cn in enumerate(self._chain(address, b"##CN")):
            _, _, data_type, bit_offset, offset, bits, *_ = mdf.CN_DATA.unpack_from(cn.data)
            if (data_type, bit_offset, offset, bits) != (mdf.FLOAT, 0, 8 * number, 64):
                raise ValueError("a signal is not float64")
            if cn.links[4]:
                raise ValueError("a signal has a conversion")
            unit = self._text(cn.links[6]) if cn.links[6] else "-"
            channels.append(Channel(self._text(cn.links[2]), unit))
        if size != 8 * len(channels) or not channels or channels[0].name != TIME.name:
            raise ValueError("its signals do not begin with the time")
        return channels

    def _frames(self, cg: mdf.Block, data: int, size: int) -> Iterator[LoggedFrame]:
        time = self._block(cg.links[1], b"##CN")
        name = self._text(self._block(time.links[0], b"##CN").links[2])
        if name not in _RECORDS:
            raise ValueError("a group of frames is none of ours")
        if name == mdf.DATA_FRAME and size == mdf.FD_RECORD.itemsize:
            yield from self._fd_frames(data)
            return
        for record in self._records(data, _RECORDS[name]).tolist():
            seconds, channel, can_id, is_extended, _, length, direction, *raw = record
            payload = bytes(raw[0])[: min(length, 8)] if raw else b""
            bus = max(channel, 1) - 1
            if name == mdf.ERROR_FRAME:
                classes = can_id & (ERROR_FLAG - 1)
                frame = Frame(ERROR_FLAG | classes, payload.ljust(8, b"\0"), bus=bus)
            else:
                is_remote = name == mdf.REMOTE_FRAME
                frame = Frame(can_id, payload, is_remote, bool(is_extended), bus)
            yield LoggedFrame(frame, round(seconds * 1e9), direction == mdf.RECEIVED)

    def _fd_frames(self, data: int) -> Iterator[LoggedFrame]:
        """Yield the frames of CAN FD.

        Yields:
            Them.

        Raises:
            ValueError: one has a length that no DLC has.
        """
        for record in self._records(data, mdf.FD_RECORD).tolist():
            seconds, channel, can_id, is_extended, _, length, direction, _, brs, esi, raw = record
            if length not in FD_LENGTHS:
                raise ValueError(f"a frame of CAN FD has {length} bytes")
            fd = FDF | BRS * bool(brs) | ESI * bool(esi)
            payload, bus = bytes(raw)[:length], max(channel, 1) - 1
            frame = Frame(can_id, payload, is_extended=bool(is_extended), bus=bus, fd=fd)
            yield LoggedFrame(frame, round(seconds * 1e9), direction == mdf.RECEIVED)

    def _records(self, data: int, dtype: np.dtype[np.void]) -> npt.NDArray[np.void]:
        """Return the records of a group.

        Raises:
            ValueError: a block of data is listed twice.
        """
        blocks: list[bytes] = []
        if data:
            header_list = self._block(data, b"##HL")
            for data_list in self._chain(header_list.links[0], b"##DL"):
                if len({*data_list.links}) < len(data_list.links):
                    raise ValueError("a block of data is listed twice")
                blocks += [
                    self._unpacked(self._block(address, b"##DZ"), dtype.itemsize)
                    for address in data_list.links[1:]
                ]
        return np.frombuffer(b"".join(blocks), dtype=dtype)

    def _unpacked(self, block: mdf.Block, record: int) -> bytes:
        kind, packing, _, size, length, packed = mdf.DZ_DATA.unpack_from(block.data)
        if (kind, packing, size) != (b"DT", mdf.TRANSPOSED, record) or length % record:
            raise ValueError("a block of data is not packed as ours are")
        self._unfolded += length
        if self._unfolded > _LARGEST:
            raise ValueError(f"its data unfold to more than {_LARGEST >> 30} GiB")
        # Never more than it says, whatever a made-up file would unfold to.
        unpacking = zlib.decompressobj()
        raw = unpacking.decompress(block.data[mdf.DZ_DATA.size : mdf.DZ_DATA.size + packed], length)
        more = unpacking.decompress(unpacking.unconsumed_tail, 1)  # compares the check sum
        if len(raw) != length or more or not unpacking.eof:
            raise ValueError("a block of data has another length than it says")
        columns = np.frombuffer(raw, dtype=np.uint8).reshape(record, -1)
        return np.ascontiguousarray(columns.T).tobytes()

    def _chain(self, address: int, kind: bytes) -> Iterator[mdf.Block]:
        """Yield blocks that are linked by their first link.

        Raises:
            ValueError: they have no end.
        """
        seen: set[int] = set()
        while address:
            if address in seen or len(seen) > max(_MOST_CHANNELS, len(self._content) // 64):
                raise ValueError("its blocks are linked in a circle")
            seen.add(address)
            block = self._block(address, kind)
            yield block
            address = block.links[0]

    def _text(self, address: int) -> str:
        return self._block(address, b"##TX").data.split(b"\0", 1)[0].decode("utf-8", "replace")

    def _block(self, address: int, kind: bytes) -> mdf.Block:
        """Return the block at an address.

        Raises:
            ValueError: there is another one, or none.
            _CutOffError: the file ends before it does.
        """
        if not address:
            raise ValueError(f"no {kind[2:].decode()} block where one should be")
        if address > len(self._content) - mdf.HEADER.size:
            raise _CutOffError
        found, _, length, count = mdf.HEADER.unpack_from(self._content, address)
        start = address + mdf.HEADER.size
        end = address + length
        if found != kind or start + 8 * count > end or count < _LINKS.get(kind, 0):
            raise ValueError(f"no {kind[2:].decode()} block where one should be")
        if end > len(self._content):
            raise _CutOffError
        links = struct.unpack_from(f"<{count}Q", self._content, start)
        return mdf.Block(kind, links, self._content[start + 8 * count : end])
