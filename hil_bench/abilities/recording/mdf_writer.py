"""Recordings as MF4 (ASAM MDF 4.1), written block by block.

At every moment the file is a finished MF4: a block of data is appended first and linked in after,
so whoever ends the writer at any moment leaves a file that ends with the last linked block. Where
it must outlast a power cut, the block is on the disk before it is linked in.
"""

import struct
import zlib
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple
from xml.sax.saxutils import escape

import numpy as np
import numpy.typing as npt

import hil_bench
from hil_bench.abilities.common.block_file import BlockFile
from hil_bench.abilities.recording import mdf_blocks as mdf
from hil_bench.canopen_device.frame import BRS, ESI, Frame
from hil_bench.frame import ERROR_FLAG, FD_LENGTHS, is_error_frame
from hil_bench.outside.recording.channels import TIME, Channel, LoggedFrame, Recording

_LINK = struct.Struct("<Q")
_COMPRESSION_LEVEL = 4

_NO_ACKNOWLEDGE = 0x020
_ERROR_TYPES = {0x01: mdf.BIT_ERROR, 0x02: mdf.FORM_ERROR, 0x04: mdf.STUFF_ERROR}
"""By the bits of the third byte of an error frame (`linux/can/error.h`)."""


class MdfFile(BlockFile):
    """An MF4 file of signals and frames.

    The groups of the error frames and of CAN FD come with the first of them, so a file without any
    has none.

    Args:
        path: the file.
        channels: the signals, `TIME` first; with `TIME` alone none.
        comment: what the file says of itself.
        started: date of time 0; None for 1970.

    Raises:
        ConfigError: the file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        channels: Sequence[Channel],
        *,
        comment: str = "",
        started: datetime | None = None,
    ) -> None:
        header = _Header(mdf.IDENTIFICATION_SIZE + len(_hd_block(0, 0, 0, 0)))
        groups = [
            header.add_frame_group(mdf.REMOTE_FRAME, mdf.REMOTE_RECORD, next_group=0),
        ]
        groups.append(header.add_frame_group(mdf.DATA_FRAME, mdf.DATA_RECORD, groups[-1].dg))
        groups.append(header.add_signal_group(channels, groups[-1].dg))
        self._remote, self._data, self._signals = groups
        self._later: dict[str, _Group] = {}
        start_ns = 0 if started is None else round(started.timestamp() * 1e9)
        super().__init__(path, header.finish(groups[-1].dg, start_ns, comment))
        self._links: list[tuple[int, bytes]] = []

    def write_rows(self, rows: Recording) -> None:
        """Append rows of the channels."""
        size = rows.dtype.itemsize
        self._append(self._signals, rows.view(np.uint8).reshape(-1, size))

    def write_frames(self, frames: Sequence[LoggedFrame]) -> None:
        """Append frames."""
        data, remote, errors, fd = [], [], [], []
        for logged in frames:
            if is_error_frame(logged.frame):
                errors.append(_error_record(logged))
            elif logged.frame.fd:
                fd.append(_fd_record(logged))
            elif logged.frame.is_remote:
                remote.append(_head_record(logged))
            else:
                data.append(_data_record(logged))
        self._append_frames(self._data, data, mdf.DATA_RECORD)
        self._append_frames(self._remote, remote, mdf.REMOTE_RECORD)
        self._append_later(mdf.ERROR_FRAME, errors, mdf.ERROR_RECORD)
        self._append_later(mdf.DATA_FRAME, fd, mdf.FD_RECORD)

    def _append_frames(
        self, group: "_Group", records: Sequence[tuple[Any, ...]], dtype: np.dtype[np.void]
    ) -> None:
        packed = np.array(records, dtype=dtype).view(np.uint8)
        self._append(group, packed.reshape(-1, dtype.itemsize))

    def _append_later(
        self, name: str, records: Sequence[tuple[Any, ...]], dtype: np.dtype[np.void]
    ) -> None:
        """Append records of a group that comes with the first of them, behind the last group."""
        if records and name not in self._later:
            header = _Header(self._file.size)
            group = header.add_frame_group(name, dtype, next_group=0)
            self._file.append(header.blocks)
            last = next(reversed(self._later.values()), self._remote)
            self._links.append((last.dg + mdf.HEADER.size, _LINK.pack(group.dg)))
            self._later[name] = group
        if records:
            self._append_frames(self._later[name], records, dtype)

    def flush(self, *, durable: bool) -> None:
        """Put on the disk what was written, then link it in; see `OutputFile.flush`."""
        self._file.flush(durable=durable)
        self._complete()

    def _complete(self) -> None:
        """Make what was appended part of the file."""
        links, self._links = self._links, []
        for address, link in links:
            self._file.overwrite(address, link)

    def _append(self, group: "_Group", records: npt.NDArray[np.uint8]) -> None:
        """Append records; they are linked in later."""
        if not len(records):
            return
        file = self._file
        address = file.append(_compressed(records))
        entry = mdf.DL_DATA.pack(0, b"", 1, group.length)
        data_list = file.append(mdf.pack_block(b"##DL", (0, address), entry))
        group.length += records.size
        group.records += len(records)
        self._links.append((group.next_link, _LINK.pack(data_list)))
        if group.is_empty:
            self._links.append((group.data_link, _LINK.pack(group.header_list)))
            group.is_empty = False
        self._links.append((group.count, _LINK.pack(group.records)))
        group.next_link = data_list + mdf.HEADER.size


class _Group:
    """The addresses of a data group in the file, and its size so far.

    Attributes:
        dg: address of its DG block.
        data_link: address of the link to its data.
        header_list: address of its HL block.
        count: address of its count of records.
        next_link: address of the link that the next data list goes into.
        length: bytes of its records.
        records: how many there are.
        is_empty: whether its data is not linked in yet.
    """

    def __init__(self, dg: int, cg: int, header_list: int) -> None:
        self.dg = dg
        self.data_link = dg + mdf.HEADER.size + 8 * 2
        self.header_list = header_list
        self.count = cg + mdf.HEADER.size + 8 * 6 + 8
        self.next_link = header_list + mdf.HEADER.size
        self.length = self.records = 0
        self.is_empty = True


class _ChannelBlock(NamedTuple):
    """A channel as its CN block has it.

    Attributes:
        name: its name.
        dtype: its type.
        offset: where it stands in a record.
        unit: its unit; empty for none.
        is_master: whether it is the time.
        members: address of the first member of a structure, 0 for no structure.
        source: address of the bus it comes from, 0 for none.
    """

    name: str
    dtype: np.dtype[Any]
    offset: int
    unit: str = ""
    is_master: bool = False
    members: int = 0
    source: int = 0


class _Header:
    """The head of the file: everything that stands before the first data; or a group after it.

    Args:
        start: address of its first block: behind the HD block, which is made last.
    """

    def __init__(self, start: int) -> None:
        self._start = start
        self._blocks: list[bytes] = []
        self._end = start

    @property
    def blocks(self) -> bytes:
        """The blocks that were added."""
        return b"".join(self._blocks)

    def finish(self, first_group: int, start_ns: int, comment: str) -> bytes:
        """Return the head with identification and HD block."""
        tool = (
            f"<FHcomment><TX>recorded</TX><tool_id>hil-bench</tool_id><tool_vendor>hil-bench"
            f"</tool_vendor><tool_version>{hil_bench.__version__}</tool_version></FHcomment>"
        )
        history_text = self._add(mdf.pack_text(tool, b"##MD"))
        history = self._add(
            mdf.pack_block(b"##FH", (0, history_text), mdf.FH_DATA.pack(start_ns, 0, 0, 0, b""))
        )
        more = mdf.UNKNOWN_EVENTS if comment else ""
        text = self._add(
            mdf.pack_text(f"<HDcomment><TX>{escape(comment)}</TX>{more}</HDcomment>", b"##MD")
        )
        identification = mdf.IDENTIFICATION.pack(
            b"MDF     ", b"4.10    ", b"hilbench", b"", mdf.VERSION, b"", 0, 0
        )
        head = _hd_block(first_group, history, text, start_ns)
        return b"".join((identification, head, self.blocks))

    def add_signal_group(self, channels: Sequence[Channel], next_group: int) -> _Group:
        """Add the group of the signals, all of them float64."""
        first = 0
        for number, channel in reversed(list(enumerate(channels))):
            block = _ChannelBlock(
                channel.name,
                np.dtype("<f8"),
                8 * number,
                channel.unit,
                is_master=channel.name == TIME.name,
            )
            first = self._add_channel(block, first)
        return self._add_group(first, 8 * len(channels), next_group)

    def add_frame_group(self, name: str, record: np.dtype[np.void], next_group: int) -> _Group:
        """Add a group of frames as the standard has them: time, then a structure of fields."""
        fields = list((record.fields or {}).items())
        first = 0
        for field, (dtype, offset, *_) in reversed(fields[1:]):
            first = self._add_channel(_ChannelBlock(f"{name}.{field}", dtype, offset), first)
        source = self._add(
            mdf.pack_block(
                b"##SI",
                (self._add(mdf.pack_text("CAN1")), 0, 0),
                mdf.SI_DATA.pack(mdf.SOURCE_BUS, mdf.BUS_CAN, 0, b""),
            )
        )
        structure = np.dtype(f"V{record.itemsize - 8}")
        frame = self._add_channel(
            _ChannelBlock(name, structure, 8, members=first, source=source), 0
        )
        time = self._add_channel(
            _ChannelBlock("Timestamp", np.dtype("<f8"), 0, "s", is_master=True), frame
        )
        return self._add_group(time, record.itemsize, next_group, source=source)

    def _add(self, block: bytes) -> int:
        address = self._end
        self._blocks.append(block)
        self._end += len(block)
        return address

    def _add_group(self, first_channel: int, size: int, next_group: int, source: int = 0) -> _Group:
        flags = mdf.BUS_EVENT | mdf.PLAIN_BUS_EVENT if source else 0
        cg = self._add(
            mdf.pack_block(
                b"##CG",
                (0, first_channel, 0, source, 0, 0),
                mdf.CG_DATA.pack(0, 0, flags, ord(".") if source else 0, b"", size, 0),
            )
        )
        header_list = self._add(
            mdf.pack_block(b"##HL", (0,), mdf.HL_DATA.pack(0, mdf.TRANSPOSED, b""))
        )
        dg = self._add(mdf.pack_block(b"##DG", (next_group, cg, 0, 0), mdf.DG_DATA.pack(0, b"")))
        return _Group(dg, cg, header_list)

    def _add_channel(self, channel: _ChannelBlock, next_channel: int) -> int:
        dtype = channel.dtype
        kinds = {"f": mdf.FLOAT, "u": mdf.UNSIGNED, "V": mdf.BYTES}
        data = mdf.CN_DATA.pack(
            mdf.MASTER if channel.is_master else mdf.VALUE,
            mdf.TIME_SYNCHRONISED if channel.is_master else 0,
            kinds[dtype.kind],
            0,
            channel.offset,
            8 * dtype.itemsize,
            mdf.CHANNEL_BUS_EVENT if channel.source else 0,
            *(0,) * 4,
            *(0.0,) * 6,
        )
        text = self._add(mdf.pack_text(channel.name))
        unit = self._add(mdf.pack_text(channel.unit)) if channel.unit else 0
        links = (next_channel, channel.members, text, channel.source, 0, 0, unit, 0)
        return self._add(mdf.pack_block(b"##CN", links, data))


def _hd_block(first_group: int, history: int, comment: int, start_ns: int) -> bytes:
    data = mdf.HD_DATA.pack(start_ns, 0, 0, 0, 0, 0, 0, 0.0, 0.0)
    return mdf.pack_block(b"##HD", (first_group, history, 0, 0, 0, comment), data)


def _compressed(records: npt.NDArray[np.uint8]) -> bytes:
    """Return records as a DZ block; transposed, because a channel's bytes are like one another."""
    packed = zlib.compress(np.ascontiguousarray(records.T).tobytes(), _COMPRESSION_LEVEL)
    size = records.shape[1]
    data = mdf.DZ_DATA.pack(b"DT", mdf.TRANSPOSED, 0, size, records.size, len(packed))
    return mdf.pack_block(b"##DZ", (), data + packed)


def _head_record(logged: LoggedFrame) -> tuple[float, int, int, int, int, int, int]:
    frame = logged.frame
    direction = mdf.RECEIVED if logged.is_received else mdf.SENT
    length = len(frame.data)
    return (
        logged.now * 1e-9,
        frame.bus + 1,
        frame.can_id,
        frame.is_extended,
        length,
        length,
        direction,
    )


def _data_record(
    logged: LoggedFrame,
) -> tuple[float, int, int, int, int, int, int, bytes]:
    return (*_head_record(logged), logged.frame.data.ljust(8, b"\0"))


def _fd_record(logged: LoggedFrame) -> tuple[Any, ...]:
    frame = logged.frame
    *head, _, length, direction = _head_record(logged)
    flags = 1, frame.fd & BRS != 0, frame.fd & ESI != 0
    dlc = FD_LENGTHS.index(length)
    return (*head, dlc, length, direction, *flags, frame.data.ljust(64, b"\0"))


def _error_record(
    logged: LoggedFrame,
) -> tuple[float, int, int, int, int, int, int, bytes, int]:
    frame = logged.frame
    shown = frame._replace(can_id=frame.can_id & ~ERROR_FLAG, is_extended=True)
    return (*_data_record(logged._replace(frame=shown)), _error_type(frame))


def _error_type(frame: Frame) -> int:
    if frame.can_id & _NO_ACKNOWLEDGE:
        return mdf.ACK_ERROR
    violations = frame.data[2] if len(frame.data) > 2 else 0
    kinds = (kind for bit, kind in _ERROR_TYPES.items() if violations & bit)
    return next(kinds, mdf.OTHER_ERROR)
