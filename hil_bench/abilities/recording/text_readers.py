"""python-can's readers of text logs, with what they take wrong put right."""

import re
from collections.abc import Callable, Generator, Iterable
from typing import Any

import can
from can.io.asc import ASCReader
from can.io.canutils import CanutilsLogReader
from can.io.trc import TRCReader
from can.util import dlc2len

from hil_bench.abilities.recording.candump_lines import CompleteLines
from hil_bench.frame import CLASSICAL_DATA

Reader = Callable[[Any], Iterable[can.Message]]


class TrcReader(TRCReader):
    """Reads PEAK's TRC, its times from its first entry on: those of python-can have the date.

    python-can 4.6 takes the bits of CAN FD wrong: FB is BRS, FE is ESI, BI is both (PEAK CAN TRC
    File Format, version 2.1).
    """

    def __iter__(self) -> Generator[can.Message, None, None]:
        for message in super().__iter__():
            message.timestamp -= self.start_time.timestamp() if self.start_time else 0.0
            yield message

    def _parse_msg_v2_x(self, cols: tuple[str, ...]) -> can.Message | None:
        message = super()._parse_msg_v2_x(cols)
        if message is not None and message.is_fd:
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
