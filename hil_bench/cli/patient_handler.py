"""Log lines on standard error that a loop never waits for."""

import logging
import select
from typing import TextIO

from hil_bench.errors import printable


class PatientHandler(logging.StreamHandler[TextIO]):
    """Leaves lines out that nobody takes: of a terminal that is stopped, a pipe that is full."""

    def __init__(self) -> None:
        super().__init__()
        self._left_out = 0

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record, where that does not mean to wait."""
        if not _takes_more(self.stream):
            self._left_out += 1
            return
        if self._left_out:
            record.msg = f"{record.msg} ({self._left_out} lines before this one are lost)"
            self._left_out = 0
        super().emit(record)

    def format(self, record: logging.LogRecord) -> str:
        """Return the line of a record, whose message may quote anything of a file."""
        lines = record.getMessage().split("\n")
        record.msg, record.args = "\n".join(map(printable, lines)), ()
        return super().format(record)


def _takes_more(stream: TextIO) -> bool:
    """Return True if a line can be written at once, or where that is unknown."""
    try:
        return bool(select.select([], [stream.fileno()], [], 0)[1])
    except (OSError, ValueError, AttributeError):
        return True
