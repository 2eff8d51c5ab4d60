"""The lines of a text log up to one that a killed writer cut off; of candump each is checked."""

import io
import re
from typing import IO

from hil_bench.canopen_device.frame import Frame
from hil_bench.frame import ERROR_FLAG, FD_LENGTHS
from hil_bench.outside.recording.channels import LoggedFrame

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

_DROPS = re.compile(r"DROPCOUNT: dropped (\d{1,10}) CAN frames? on .* socket ")
"""The line of `candump -d` where its socket could not keep up, by can-utils 2020 and newer."""

_ON_SCREEN = re.compile(r"\s*(?:\(\S+\)\s+)?\S+\s.*\s[0-9A-F]{3,8}\s+\[\d+\](?:\s|$)")
"""A line as candump shows it on a terminal."""

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
        error_frames: lines that are one, and are left out.
        damaged: lines that are no frame, and are left out.
        first_damaged: number of the first of them.
        on_screen: of them those that candump shows on a terminal.
        dropped: frames that candump says it has lost.
        number: of the last line.
    """

    says_direction = False
    ending = ""
    error_frames = damaged = first_damaged = on_screen = dropped = number = 0

    def __init__(self, file: IO[bytes], *, candump: bool) -> None:
        """Read a file.

        Args:
            file: the log.
            candump: whether each line is to be one of candump -L; any is right otherwise.
        """
        super().__init__(file, encoding="utf-8", errors="replace")
        self._form = _LINE if candump else None
        self._errors: list[LoggedFrame] = []

    def take_errors(self) -> list[LoggedFrame]:
        """Return the error frames that were left out since the last call."""
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
            if not line.endswith("\n"):
                self.ending = "its last line is cut off"
                raise StopIteration
            if _ERROR_FRAME.match(line):
                self.error_frames += 1
                parts = _ERROR_PARTS.match(line)
                if parts is not None and len(self._errors) < _KEPT_ERRORS:
                    self._errors.append(_error_of(parts))
            elif self._form is None or self._form.fullmatch(line) or line.isspace():
                self.says_direction = line.rstrip().endswith(_DIRECTIONS)
                return line
            elif drop := _DROPS.match(line):
                self.dropped += int(drop[1])
            else:
                self.on_screen += _ON_SCREEN.match(line) is not None
                self.damage()


def _error_of(match: re.Match[str]) -> LoggedFrame:
    """Return the error frame of a line of a candump log."""
    time, bus, can_id, data = match.groups()
    number = int(bus) % _MOST_BUSES if bus else 0
    frame = Frame(int(can_id, 16) & _ERROR_BITS, bytes.fromhex(data).ljust(8, b"\0"), bus=number)
    return LoggedFrame(frame, round(float(time) * 1e9), None)
