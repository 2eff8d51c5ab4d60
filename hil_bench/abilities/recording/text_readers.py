"""Readers of text logs."""

import io
import re
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Sequence
from typing import IO, Any

import can
from can.io.asc import ASCReader
from can.io.canutils import CanutilsLogReader
from can.io.trc import TRCReader
from can.util import dlc2len

from hil_bench.canopen_device.frame import BRS, ESI, Frame
from hil_bench.errors import ConfigError
from hil_bench.frame import CLASSICAL_DATA, ERROR_FLAG, FD_LENGTHS
from hil_bench.outside.recording.channels import LoggedFrame

# The lines of a text log up to one that a killed writer cut off; of candump each is checked.


_ERROR_FRAME = re.compile(r"\(\S+\) \S+ [2367ABEF][0-9A-F]{7}#")
"""A line of a candump log whose identifier has SocketCAN's flag of error frames (bit 29). Of most
of them python-can makes data frames."""

_FD_DATA = "|".join(f"(?:[0-9A-F]{{2}}){{{length}}}" for length in FD_LENGTHS)
_LINE = re.compile(
    r"\(\d{1,12}\.\d{1,9}\) \S+ (?:[0-9A-F]{3}|[0-9A-F]{8})"
    rf"#(?:(?:[0-9A-F]{{2}}){{0,8}}|R[0-8]?|#[0-7](?:{_FD_DATA}))(?: [RT])?\s*",
    re.IGNORECASE,
)
"""A line of a candump log. One of CAN FD has a second # and a digit of flags, as `Frame.fd`."""

_FIRST = {
    ".asc": re.compile(r"\ufeff?\s*(date|base|//|(no )?internal|begin)\b", re.IGNORECASE),
    ".trc": re.compile(r"\ufeff?\s*;"),
}
"""How the first line of a text log begins, by its suffix."""

_FORMS = {
    ".log": "not one line is one of candump -L",
    ".asc": 'it does not begin with "date" or "base", as Vector\'s tools write it',
    ".trc": 'it does not begin with ";", as PEAK\'s tools write it',
}
"""Why a text is no log, by its suffix."""

_DROPS = re.compile(r"DROPCOUNT: dropped (\d{1,10}) CAN frames? on .* socket ")
"""The line of `candump -d` where its socket could not keep up, by can-utils 2020 and newer."""

_ON_SCREEN = re.compile(
    r"\s*(?:\((\S+)\)\s+)?(\S+)\s+(?:([RT])X ([B-]) ([E-])\s+)?([0-9A-F]{3}|[0-9A-F]{8})\s+"
    r"\[(\d{1,2})\]\s*(remote request|(?:[0-9A-F]{2}(?:\s+|$))*)(?:'.*'|ERRORFRAME)?\s*",
    re.IGNORECASE,
)
"""A line as candump shows it on a terminal: time, interface, with -x way, BRS and ESI, then
identifier, length (of two digits with CAN FD) and data."""

_LONGEST_SHOWN = 500  # with 64 bytes of CAN FD, as hexadecimal and as characters
_TIME = re.compile(r"\d{1,12}\.\d{1,9}")

_ERROR_PARTS = re.compile(
    r"\((\d{1,12}\.\d{1,9})\) \S*?(\d{0,4}) ([0-9A-F]{8})#((?:[0-9A-F]{2}){0,8})\s"
)
_ERROR_CLASSES = 0x1FFF_FFFF
_ERROR_BITS = ERROR_FLAG | _ERROR_CLASSES
_MOST_BUSES = 32
_KEPT_ERRORS = 10_000

_DIRECTIONS = (" R", " T")
"""How python-can ends the lines of a candump log: received or sent. Wireshark takes such a line for
damaged, so ours end with the data, as those of candump do."""


class CompleteLines(io.TextIOWrapper):
    """Lines up to one that lacks its end, as a killed writer leaves it.

    Attributes:
        says_direction: whether the last line ends as one of python-can's candump logs.
        ending: why it ends before its end; empty where it does not.
        shortcoming: why it is no such log, where `is_of_form` says so.
        error_frames: lines that are one, and are left out.
        damaged: lines that are no frame, and are left out.
        first_damaged: number of the first of them.
        on_screen: of them those that candump shows on a terminal.
        dropped: frames that candump says it has lost.
        number: of the last line.
        states: of the adapter that a TRC says, by name or code, and how often.
        trc_version: of a TRC; empty where it has none.
    """

    says_direction = False
    ending = ""
    error_frames = damaged = first_damaged = on_screen = dropped = number = 0

    def __init__(self, file: IO[bytes], suffix: str) -> None:
        """Read a file.

        Args:
            file: the log.
            suffix: of its name; in a ``.log`` each line is to be one of candump -L.
        """
        super().__init__(file, encoding="utf-8", errors="replace")
        self._form = _LINE if suffix == ".log" else None
        self._first = _FIRST.get(suffix)
        self.shortcoming = _FORMS[suffix]
        self._begins = True
        self._errors: list[tuple[str, LoggedFrame]] = []
        self._shown_until = 0.0
        self.states: Counter[str] = Counter()
        self.trc_version = ""

    def is_of_form(self) -> bool:
        """Return True if the lines so far may be those of such a log, though without frames."""
        return self._begins and (self._form is None or not self.damaged)

    def take_errors(self) -> list[tuple[str, LoggedFrame]]:
        """Return the error frames that were left out since the last call, with their channels."""
        errors, self._errors = self._errors, []
        self.error_frames -= len(errors)
        return errors

    def damage(self) -> None:
        """Count the last line as one that is no frame."""
        self.damaged += 1
        self.first_damaged = self.first_damaged or self.number

    def __next__(self) -> str:  # type: ignore[override]  # as TextIOWrapper itself has it
        while True:
            line = super().__next__()
            self.number += 1
            if self._form is None:
                line = self._of_head(line)
            if not line.endswith("\n"):
                self.ending = "its last line has no line end, and is left out"
                raise StopIteration
            is_shown = self._form is not None and "[" in line and len(line) < _LONGEST_SHOWN
            shown = _ON_SCREEN.fullmatch(line) if is_shown else None
            if shown is not None:
                line = self._logged(shown) or line
            if _ERROR_FRAME.match(line):
                self.error_frames += 1
                parts = _ERROR_PARTS.match(line)
                if parts is not None and len(self._errors) < _KEPT_ERRORS:
                    self._errors.append((line.split()[1], _error_of(parts)))
            elif self._form is None or self._form.fullmatch(line) or line.isspace():
                self.says_direction = line.rstrip().endswith(_DIRECTIONS)
                return line
            elif drop := _DROPS.match(line):
                self.dropped += int(drop[1])
            else:
                self.on_screen += shown is not None
                self.damage()

    def _of_head(self, line: str) -> str:
        """Return a line as python-can takes it, with what it says of the whole file looked at.

        Raises:
            ValueError: the first one is of no such log, in which python-can might find frames.
        """
        if self._first is not None and line.strip():
            self._begins = self._first.match(line) is not None
            if not self._begins:
                raise ValueError("does not begin as such a log")
            self._first = None
        if line.startswith(";$FILEVERSION="):
            self.trc_version = line.partition("=")[2].strip()
        elif line.startswith(";$STARTTIME="):  # PEAK's own of version 1.2 ends with a semicolon
            return line.rstrip("; \r\n") + "\n"
        return line

    def _logged(self, shown: re.Match[str]) -> str:
        """Return the line of candump -L for one of a terminal, empty where it says too little.

        Raises:
            ConfigError: its time goes back, as one does that each line counts anew.
        """
        time, bus, way, brs, esi, can_id, length, data = shown.groups()
        if time is None or not _TIME.fullmatch(time):
            return ""
        if float(time) < self._shown_until:
            raise ConfigError(
                f"line {self.number}: its time goes back, as with candump -t d; show absolute "
                "times by -t a, or record with -l"
            )
        self._shown_until = float(time)
        content = "".join(data.split())
        if data.startswith("r"):
            content = f"R{int(length)}"
        elif len(content) != 2 * int(length):
            return ""
        elif len(length) == 2:
            content = f"#{BRS * (brs == 'B') | ESI * (esi == 'E')}{content}"
        return f"({time}) {bus} {can_id}#{content}{f' {way}' if way else ''}\n"


def _error_of(match: re.Match[str]) -> LoggedFrame:
    """Return the error frame of a line of a candump log."""
    time, bus, can_id, data = match.groups()
    number = int(bus) % _MOST_BUSES if bus else 0
    frame = Frame(int(can_id, 16) & _ERROR_BITS, bytes.fromhex(data).ljust(8, b"\0"), bus=number)
    return LoggedFrame(frame, round(float(time) * 1e9), None)


# python-can's readers of text logs, with what they take wrong put right.


Reader = Callable[[Any], Iterable[can.Message]]


_TRC1_REPORTS = frozenset({"Error", "ERROR", "Warng", "FFFFFFFF"})
_TRC2_REPORTS = frozenset({"ER", "ST", "EC", "EV"})
"""Lines that are no frame, by version: error frames, states and counters of the adapter, events of
its user. In version 1.0 ERROR stands before the data, and the identifier of a state is FFFFFFFF."""

_TRC_VIOLATIONS = 0x7  # bit, form and stuff error, as SocketCAN has them; 8 is another one
_PROTOCOL, _SENDING = 0x8, 0x80
"""Of SocketCAN: class of a violated protocol, and where in its data the sender has seen it."""

_MOST_STATES = 10
_BYTE = re.compile("[0-9A-F]{2}", re.IGNORECASE)


class TrcReader(TRCReader):
    """Reads PEAK's TRC, its times from its first entry on: those of python-can have the date.

    python-can 4.6 takes the bits of CAN FD wrong: FB is BRS, FE is ESI, BI is both (PEAK CAN TRC
    File Format, version 2.1). It leaves out what it cannot read without a word, or ends there.

    Args:
        lines: the file; counts the lines that are left out.
    """

    def __init__(self, lines: CompleteLines) -> None:
        super().__init__(lines)
        self._lines = lines

    def _extract_header(self) -> str:
        line = super()._extract_header()
        if self._lines.trc_version == "1.2":  # as 1.3 without its column for nothing
            self._parse_cols = lambda cols: self._parse_cols_v1_3((*cols[:5], "-", *cols[5:]))
        return line

    def _parse_line(self, line: str) -> can.Message | None:
        try:
            words = line.split()
            if kind := self._report_of(words):
                return self._take_report(kind, words)
            return self._parse_cols(tuple(line.split(maxsplit=self._num_columns)))
        except (ValueError, IndexError):
            if line and not line.startswith(";"):  # of a head with nothing behind it
                self._lines.damage()
            return None

    def _report_of(self, words: Sequence[str]) -> str:
        """Return the kind of a line that is no frame; empty for one."""
        if self.columns:
            kind = words[self.columns["T"]]
            return kind if kind in _TRC2_REPORTS else ""
        return next((word for word in words[2:5] if word in _TRC1_REPORTS), "")

    def _take_report(self, kind: str, words: Sequence[str]) -> can.Message | None:
        """Return the error frame of a line, or count the adapter's state that it says."""
        names: list[str] = []
        data: list[int] = []
        for word in reversed(words):
            if _BYTE.fullmatch(word):
                data.insert(0, int(word, 16))
            elif data:
                break
            elif word != "--":
                names.append(word)
        if kind in {"Warng", "FFFFFFFF", "ST"}:
            name = names[0] if names else f"0x{bytes(data).hex()}"
            states = self._lines.states
            states[name if name in states or len(states) < _MOST_STATES else "others"] += 1
        if kind not in {"Error", "ERROR", "ER"}:
            return None
        at = 2 if kind == "ERROR" else words.index(kind) + 1  # of the identifier
        type_, way = data[:2] if self.columns else (int(words[at], 16), data[0])
        return can.Message(
            timestamp=float(words[self.columns.get("O", 1)]) / 1000 + self._start_time,
            arbitration_id=_PROTOCOL,
            data=bytes((0, 0, type_ & _TRC_VIOLATIONS | (0 if way else _SENDING), 0, 0, 0, 0, 0)),
            is_error_frame=True,
            channel=1,
        )

    def __iter__(self) -> Generator[can.Message, None, None]:
        for message in super().__iter__():
            message.timestamp -= self.start_time.timestamp() if self.start_time else 0.0
            yield message

    def _parse_msg_v2_x(self, cols: tuple[str, ...]) -> can.Message | None:
        message = super()._parse_msg_v2_x(cols)
        if message is None:
            return None
        length = int(cols[self.columns["l"]]) if "l" in self.columns else 0
        length = length or dlc2len(int(cols[self.columns["L"]]) if "L" in self.columns else 0)
        if len(message.data) != length and not message.is_remote_frame:
            raise ValueError("length and data differ")
        if message.is_fd:
            kind = cols[self.columns["T"]]
            message.bitrate_switch = kind in {"FB", "BI"}
            message.error_state_indicator = kind in {"FE", "BI"}
            if "l" not in self.columns:  # python-can takes the DLC for the length
                message.dlc = dlc2len(message.dlc)
        return message


class AscReader(ASCReader):
    """Leaves out a line that is cut or contradicts itself, at which python-can ends or guesses.

    Args:
        lines: the file; counts the lines that are left out.
    """

    def __init__(self, lines: CompleteLines) -> None:
        super().__init__(lines)
        self._lines = lines

    def _extract_header(self) -> None:
        super()._extract_header()
        if self.timestamps_format == "relative":
            raise ConfigError(
                "its times are relative, each to the line before; export it with absolute ones, or "
                "write absolute in its header where they are"
            )

    def _process_classic_can_frame(self, line: str, msg_kwargs: dict[str, Any]) -> can.Message:
        try:
            return super()._process_classic_can_frame(line, msg_kwargs)
        except (ValueError, IndexError):
            return self._damage()

    def _process_fd_can_frame(self, line: str, msg_kwargs: dict[str, Any]) -> can.Message:
        try:
            return self._fd_message(line, msg_kwargs)
        except (ValueError, IndexError):
            return self._damage()

    def _fd_message(self, line: str, fields: dict[str, Any]) -> can.Message:
        """Return the message of a line of CAN FD.

        Raises:
            ValueError: it is cut or contradicts itself.
        """
        parts = _ASC_FD.match(line)
        if parts is None and _ASC_FD_ERROR.match(line):
            return super()._process_fd_can_frame(line, fields)
        if parts is None:
            raise ValueError("fields are missing")
        dlc, length, words = int(parts[1], self._converted_base), int(parts[2]), parts[3].split()
        data, rest = words[:length], words[length:]
        is_right = dlc2len(dlc) == length or length == 0  # of a remote frame
        if not is_right or len(data) < length or not all(map(self._is_byte, data)):
            raise ValueError("DLC, length and data differ")
        message = super()._process_fd_can_frame(f"{line} 0", fields)  # it wants a word of data
        told = _ASC_FLAGS.fullmatch(" ".join(rest[2:3]))
        flags = int(told[0], 16) if told else _ASC_EDL
        has_edl = flags & _ASC_EDL != 0 and length == dlc2len(dlc)
        message.is_fd = length > CLASSICAL_DATA or has_edl
        is_remote = length == 0 and (dlc > 0 or flags & _ASC_RTR != 0)
        message.is_remote_frame = is_remote and not message.is_fd
        message.data = message.data[:length]
        return message

    def _is_byte(self, word: str) -> bool:
        return _ASC_BYTES[self._converted_base].fullmatch(word) is not None

    def _damage(self) -> can.Message:
        self._lines.damage()
        return None  # type: ignore[return-value]  # its caller takes None for no message


_ASC_FD = re.compile(
    r"\d+ +[RT]x +[0-9A-F]+x? +(?:\S*[^\d\s]\S* +)?[01] +[01] +([0-9A-F]{1,2}) +(\d\d?)((?: .*)?)",
    re.IGNORECASE,
)
"""A line of CAN FD behind "CANFD": channel, way, identifier and its name, BRS, ESI, then the DLC,
the count of data bytes, these, and what else Vector's tools know of the frame."""

_ASC_FD_ERROR = re.compile(r"\d+ +[RT]x +ErrorFrame", re.IGNORECASE)
_ASC_BYTES = {16: re.compile("[0-9A-F]{2}", re.IGNORECASE), 10: re.compile("[0-9]{1,3}")}
_ASC_FLAGS = re.compile("[0-9A-F]{1,8}", re.IGNORECASE)
_ASC_RTR, _ASC_EDL = 0x10, 0x1000
"""Of the flags behind the data, duration and length: remote frame, frame of CAN FD. A channel of
CAN FD has classical frames, too."""

TEXT_READERS: dict[str, Reader] = {
    ".asc": AscReader,
    ".log": CanutilsLogReader,
    ".trc": TrcReader,
}
"""By the suffix of the file."""
