"""Bus traffic as a file, in the formats that CAN tools read."""

import io
import math
import re
import zlib
from collections import Counter
from collections.abc import Generator, Iterable, Iterator
from dataclasses import dataclass, field
from datetime import datetime
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any

import can
from can.io.asc import ASCWriter
from can.io.blf import (
    LOG_CONTAINER,
    LOG_CONTAINER_STRUCT,
    NO_COMPRESSION,
    OBJ_HEADER_BASE_STRUCT,
    ZLIB_DEFLATE,
    BLFParseError,
    BLFReader,
    BLFWriter,
)

from hil_bench.abilities.common.block_file import BUS_LOGS, READ_LOGS, BlockFile, CandumpFile
from hil_bench.abilities.recording.mdf_blocks import IDENTIFICATION_SIZE
from hil_bench.abilities.recording.mdf_reader import ForeignMdfError, read_mdf
from hil_bench.abilities.recording.text_readers import TEXT_READERS, CompleteLines, Reader
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ConfigError, about_file, printable
from hil_bench.frame import ERROR_FLAG, is_error_frame
from hil_bench.outside import messages as can_messages
from hil_bench.outside.recording.channels import LoggedFrame

_ERROR_CLASSES = 0x1FFF_FFFF

_NO_DATE = datetime(1970, 1, 1)  # noqa: DTZ001 - the format has local time
"""Of an ASC file in virtual time: the same bytes whenever it was written."""

_EMPTY_OBJECT = re.compile(rb"LOBJ.{4}\0{4}", re.DOTALL)
"""An object of a BLF file whose size, the four bytes after the header's size and version, is 0."""


_SHOWN = 100  # characters of a reader's complaint, which may quote its file
_LARGEST_CONTAINER = 64 << 20
"""Of a BLF file, unpacked [byte]; Vector's and python-can's have 128 KiB."""


def open_frame_file(path: Path, started: datetime | None = None) -> BlockFile:
    """Return a file of frames on the recording's time base, written block by block.

    Args:
        path: the file; its suffix, one of `BUS_LOGS`, is its format.
        started: date of time 0, for the format that has one; None where time is virtual.

    Raises:
        ConfigError: the suffix is unknown, or the file cannot be written.
    """
    match path.suffix.lower():
        case ".log":
            return CandumpFile(path)
        case ".asc":
            return _AscFile(path, started)
        case ".blf":
            return _BlfFile(path)
    right = f"give a file name that ends in one of {' '.join(BUS_LOGS)}"
    raise ConfigError(f'{path}: no format has the suffix "{path.suffix}"; {right}')


class _AscWriter(ASCWriter):
    """Heads the file with the date of time 0, where python-can has that of writing."""

    def __init__(self, text: "_Text", started: datetime | None) -> None:
        self._started = started.astimezone() if started else _NO_DATE
        super().__init__(text)

    def _format_header_datetime(self, dt: datetime) -> str:  # noqa: ARG002 - python-can's
        return super()._format_header_datetime(self._started)


class _AscFile(BlockFile):
    """Has python-can write lines into memory, and appends them to the file as one block."""

    def __init__(self, path: Path, started: datetime | None) -> None:
        super().__init__(path)
        self._text = _Text()
        self._writer = _AscWriter(self._text, started)
        # Its times count from its first entry, and ours from the recording's start.
        self._writer.log_event("Start of recording", 0.0)

    def write_frames(self, frames: Iterable[LoggedFrame]) -> None:
        for logged in frames:
            self._writer(message_of(logged))
        self._complete()

    def close(self) -> None:
        self._writer.stop()
        super().close()

    def _complete(self) -> None:
        text = self._text.getvalue()
        self._text.seek(0)
        self._text.truncate()
        self._file.append(text.encode())


class _Text(io.StringIO):
    """Text that outlives the writer that closes it."""

    def close(self) -> None:
        """Stay open."""


class _BlfFile(BlockFile):
    """Has python-can write containers into memory, and appends them to the file as one block."""

    def __init__(self, path: Path) -> None:
        self._writer = _BlockBlfWriter()
        super().__init__(path, self._writer.take_head(0))

    def write_frames(self, frames: Iterable[LoggedFrame]) -> None:
        for logged in frames:
            self._writer(message_of(logged))

    def _complete(self) -> None:
        self._file.append(self._writer.take_containers())
        self._file.overwrite(0, self._writer.take_head(self._file.size))


class _BlockBlfWriter(BLFWriter):
    """python-can's writer, which by itself waits for 128 KiB and for its end."""

    def __init__(self) -> None:
        self._memory = io.BytesIO()
        super().__init__(self._memory)
        self.start_timestamp = 0.0  # ours count from the recording's start, not the first frame

    def take_containers(self) -> bytes:
        """Return the bytes to append to the file."""
        while self._buffer_size:
            self._flush()
        return self._take()

    def take_head(self, size: int) -> bytes:
        """Return the head of a file of that size."""
        self._take()
        self._write_header(size)
        return self._take()

    def _take(self) -> bytes:
        content = self._memory.getvalue()
        self._memory.seek(0)
        self._memory.truncate()
        return content


@dataclass(slots=True)
class LeftOut:
    """The parts of a log that are not among its frames.

    Attributes:
        error_frames: of the bus.
        bad_lengths: frames of a length that no DLC has.
        damaged_lines: of a candump log, which are no frames.
        first_damaged: number of the first of them.
        dropped: frames that the log says its recorder has lost.
        ending: why the log ends before its end; empty where it does not.
        states: of the adapter, by name or code, and how often.
        channels: frames of other channels than the one that is read, by channel.
    """

    error_frames: int = 0
    bad_lengths: int = 0
    damaged_lines: int = 0
    first_damaged: int = 0
    dropped: int = 0
    ending: str = ""
    states: Counter[str] = field(default_factory=Counter)
    channels: Counter[str] = field(default_factory=Counter)

    def words(self) -> list[str]:
        """Return a phrase for each kind of what was left out."""
        found = []
        if self.error_frames:
            found.append(f"{self.error_frames} error frames, which say nothing of a node")
        if self.bad_lengths:
            found.append(f"{self.bad_lengths} frames of a length that no DLC has left out")
        if self.dropped:
            found.append(f"{self.dropped} frames were lost by candump, says the log")
        if self.damaged_lines:
            first = f"line {self.first_damaged} is no frame of its format"
            more = self.damaged_lines - 1
            found.append(
                f"{first}, nor are {more} more; left out" if more else f"{first}; left out"
            )
        if self.states:
            names = printable(", ".join(self.states))
            found.append(f"lines on the adapter's state ({names}) left out: {self.states.total()}")
        if self.channels:
            others = printable(", ".join(f"{n} of {name}" for name, n in self.channels.items()))
            found.append(
                f"frames of other channels left out ({others}); a log of each is read alone"
            )
        if self.ending:
            found.append(f"ends early: {self.ending}")
        return found


def read_frames(
    path: Path,
    left_out: LeftOut | None = None,
    *,
    errors: bool = False,
    buses: int | None = None,
) -> Iterator[LoggedFrame]:
    """Yield the frames of a recording.

    A log whose writer was killed ends with its last complete frame. Error frames are left out. A
    candump log says of no frame whether it was received, unless python-can wrote
    it.

    Args:
        path: the log.
        left_out: counts what is left out.
        errors: whether to yield error frames, too; see `hil_bench.frame.ERROR_FLAG`.
        buses: number of buses whose frames are read, None for all channels as one bus. Of one it
            is the channel of the first frame, of several the number in which a channel's name ends
            is that of its bus, as a bench writes it; other channels are left out.

    Yields:
        The frames, in the order of the file.

    Raises:
        ConfigError: the file cannot be read, or holds no frames.
    """
    suffix = path.suffix.lower()
    left_out = left_out or LeftOut()
    if suffix == ".mf4":
        yield from _read_mf4(path, left_out, errors=errors)
        return
    if suffix not in READ_LOGS:
        right = f"give a file that ends in one of {' '.join(READ_LOGS)} .mf4"
        raise ConfigError(f'{path}: no log of frames has the suffix "{path.suffix}"; {right}')
    frames = _read_log(path, left_out, errors=errors, is_one_channel=buses == 1)
    if buses is None or buses == 1:
        yield from (logged for _, logged in frames)
        return
    for channel, logged in frames:
        bus = _bus_number(channel)
        if bus < buses:
            yield logged._replace(frame=logged.frame._replace(bus=bus))
        else:
            left_out.channels[channel] += 1


def _bus_number(channel: str) -> int:
    digits = channel[len(channel.rstrip("0123456789")) :]
    return int(digits or 0)


def _read_log(
    path: Path, left_out: LeftOut, *, errors: bool, is_one_channel: bool
) -> Iterator[tuple[str, LoggedFrame]]:
    """Yield the frames of a log that is no MF4, each with its channel."""
    suffix = path.suffix.lower()
    with about_file(path, what="cannot be read", right="give a log of frames"):
        file = path.open("rb")
    with file:
        if suffix == ".blf":
            messages = _messages(path, _BlfReader, file, left_out, errors=errors)
            if is_one_channel:
                messages = _one_channel(messages, left_out)
            for message in messages:
                yield str(message.channel), logged_frame_of(message)
            return
        lines, seen = CompleteLines(file, suffix), 0
        messages = _messages(path, TEXT_READERS[suffix], lines, left_out, errors=errors)
        channel = ""
        if is_one_channel:
            messages = _one_channel(messages, left_out)
        for message in messages:
            channel = str(message.channel) if is_one_channel else ""
            if errors:
                yield from _of_channel(channel, lines.take_errors(), left_out)
            seen += 1
            logged = logged_frame_of(message)
            if suffix == ".log" and not lines.says_direction:
                logged = logged._replace(is_received=None)
            yield str(message.channel), logged
        if errors:
            for name, logged in _of_channel(channel, lines.take_errors(), left_out):
                seen += 1
                yield name, logged
        _close(path, lines, seen, left_out)


def _close(path: Path, lines: CompleteLines, seen: int, left_out: LeftOut) -> None:
    """Count what a text log has beside its frames.

    Raises:
        ConfigError: it has none, and is no log.
    """
    if not seen and not lines.error_frames and not lines.is_of_form():
        right = "SavvyCAN converts the logs of many tools"
        if lines.on_screen:
            right = "what it shows on a terminal has a time with -t a; or record with -l"
        raise ConfigError(f"{path}: is no log of frames: {lines.shortcoming}; {right}")
    left_out.dropped = lines.dropped
    left_out.states = lines.states
    left_out.ending = left_out.ending or lines.ending
    left_out.error_frames += lines.error_frames
    left_out.damaged_lines, left_out.first_damaged = lines.damaged, lines.first_damaged


def _read_mf4(path: Path, left_out: LeftOut, *, errors: bool) -> Iterator[LoggedFrame]:
    """Yield the frames of an MF4; python-can reads those of other tools by way of asammdf.

    Yields:
        The frames, in the order of time.

    Raises:
        ConfigError: it is of another tool, and asammdf is not installed.
        ForeignMdfError: it is no MF4.
    """
    try:
        content = read_mdf(path)
    except ForeignMdfError as error:
        with path.open("rb") as file:  # by its path, python-can would leave it open
            if not file.read(IDENTIFICATION_SIZE + 4).endswith(b"##HD"):
                raise
            if find_spec("asammdf") is None:
                right = "to read the frames of other MF4, pip install asammdf"
                raise ConfigError(f"{error.words}; {right}") from None
            from can.io.mf4 import MF4Reader  # noqa: PLC0415 - asammdf takes seconds

            file.seek(0)
            found = _messages(path, MF4Reader, file, left_out, errors=errors)
            yield from map(logged_frame_of, found)
        return
    for logged in content.frames:
        if errors or not is_error_frame(logged.frame):
            yield logged
        else:
            left_out.error_frames += 1


class _BlfReader(BLFReader):
    """Ends where python-can would read forever, or fill the memory.

    An object that claims no bytes has no end, and a container may unfold to a thousand times its
    size.
    """

    def __iter__(self) -> Generator[can.Message, None, None]:
        while head := self.file.read(OBJ_HEADER_BASE_STRUCT.size):
            signature, _, _, size, kind = OBJ_HEADER_BASE_STRUCT.unpack(head)
            if signature != b"LOBJ" or size < len(head):
                raise BLFParseError("no object where one should be")
            body = self.file.read(size - len(head))
            self.file.read(size % 4)
            if kind == LOG_CONTAINER:
                yield from self._parse_container(_unpacked(body))
        self.stop()

    def _parse_container(self, data: bytes) -> Iterator[can.Message]:
        data, self._tail = self._tail + data, b""
        empty = _EMPTY_OBJECT.search(data)
        yield from super()._parse_container(data[: empty.start()] if empty else data)
        if empty:
            raise BLFParseError("an object of the file claims no bytes")


def _unpacked(container: bytes) -> bytes:
    """Return the content of a container of a BLF file.

    Raises:
        BLFParseError: it is packed in another way, or larger than any tool writes it.
    """
    method, _ = LOG_CONTAINER_STRUCT.unpack_from(container)
    packed = container[LOG_CONTAINER_STRUCT.size :]
    if method == NO_COMPRESSION:
        return packed
    if method != ZLIB_DEFLATE:
        raise BLFParseError(f"a container is packed by the unknown method {method}")
    unpacking = zlib.decompressobj()
    data = unpacking.decompress(packed, _LARGEST_CONTAINER)
    if unpacking.unconsumed_tail:
        raise BLFParseError(f"a container unfolds to more than {_LARGEST_CONTAINER >> 20} MiB")
    if not unpacking.eof:
        raise BLFParseError("a container ends before its content does")
    return data


def _messages(
    path: Path, reader: Reader, source: IO[Any], left_out: LeftOut, *, errors: bool
) -> Iterator[can.Message]:
    """Yield messages until the end, or until what a killed writer left half written.

    Yields:
        Those with a length that a frame can have.

    Raises:
        ConfigError: not one frame could be read.
    """
    messages, is_empty = _begin(reader, source), True
    while True:
        try:
            message = next(messages)
        except StopIteration:
            return
        except ConfigError as error:
            raise ConfigError(f"{path}: {error}") from None
        except Exception as error:  # python-can's readers raise what their parsing meets
            reason = printable((str(error).splitlines() or [type(error).__name__])[0])[:_SHOWN]
            if isinstance(source, CompleteLines) and not source.is_of_form():
                reason = source.shortcoming
            if is_empty:
                raise ConfigError(f"{path}: is no log of frames: {reason}") from None
            left_out.ending = f"what follows cannot be read ({reason})"
            return
        is_empty = False
        if isinstance(source, CompleteLines) and not math.isfinite(message.timestamp):
            source.damage()
        elif message.is_error_frame and not errors:
            left_out.error_frames += 1
        elif can_messages.has_bad_length(message) and not message.is_error_frame:
            left_out.bad_lengths += 1
        else:
            yield message


def _begin(reader: Reader, source: IO[Any]) -> Iterator[can.Message]:
    yield from reader(source)


def _one_channel(messages: Iterator[can.Message], left_out: LeftOut) -> Iterator[can.Message]:
    """Yield the messages of the first one's channel, and count those of others."""
    first: object = None
    for message in messages:
        first = message.channel if first is None else first
        if message.channel == first:
            yield message
        else:
            left_out.channels[str(message.channel)] += 1


def _of_channel(
    channel: str, errors: Iterable[tuple[str, LoggedFrame]], left_out: LeftOut
) -> Iterator[tuple[str, LoggedFrame]]:
    """Yield the error frames of a channel, of any where it is empty, and count those of others."""
    for name, logged in errors:
        if channel in {"", name}:
            yield name, logged
        else:
            left_out.channels[name] += 1


def logged_frame_of(message: can.Message) -> LoggedFrame:
    """Return a message of python-can as a recording holds it."""
    if message.is_error_frame:
        data = bytes(message.data).ljust(8, b"\0")[:8]
        frame = Frame(ERROR_FLAG | message.arbitration_id & _ERROR_CLASSES, data)
        return LoggedFrame(frame, round(message.timestamp * 1e9), message.is_rx)
    fd = can_messages.fd_of(message)
    frame = Frame(
        message.arbitration_id,
        bytes(message.data),
        is_remote=message.is_remote_frame and not fd,
        is_extended=message.is_extended_id,
        fd=fd,
    )
    return LoggedFrame(frame, round(message.timestamp * 1e9), message.is_rx)


def message_of(logged: LoggedFrame) -> can.Message:
    """Return a recorded frame as python-can's message; the channel of the first bus is "can0"."""
    message = can_messages.message_of(logged.frame)
    if is_error_frame(logged.frame):
        message.arbitration_id &= ~ERROR_FLAG
        message.is_extended_id = message.is_error_frame = True
    message.timestamp = logged.now * 1e-9
    message.is_rx = logged.is_received is not False
    message.channel = f"can{logged.frame.bus}"
    return message
