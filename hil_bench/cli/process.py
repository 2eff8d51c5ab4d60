"""The process around a verb: its streams, its log, its collection of garbage."""

import argparse
import contextlib
import gc
import logging
import os
import select
import sys
from collections.abc import Iterator
from typing import TextIO

from hil_bench.errors import printable

# The standard streams, however this process was started.

_STREAMS = (("stdin", "r"), ("stdout", "w"), ("stderr", "w"))


def prepare_streams() -> None:
    """Have all three streams open, and no character that they cannot take.

    Python has None for a stream that was closed, and the next socket or file gets its number. A
    character that the encoding lacks is printed as an escape sequence in place of an error.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) < len(_STREAMS):
        pass
    os.close(number)
    for number, (name, mode) in enumerate(_STREAMS):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115 - it stays open
        elif mode == "w" and hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def keep_output() -> None:
    """Keep standard output for Python's own; what machine code prints there goes to errors.

    For good: the C library writes some of it when the process ends.
    """
    stream = sys.stdout
    kept = os.dup(1)
    os.dup2(2, 1)
    sys.stdout = os.fdopen(kept, "w", encoding=stream.encoding, errors="backslashreplace")


def flush_output() -> None:
    """Write what was printed, where a failure can still be told.

    Raises:
        OSError: nobody reads it, or there is no room for it; it is dropped then.
    """
    try:
        sys.stdout.flush()
    except OSError:
        discard_output()
        raise


def discard_lost_terminal() -> None:
    """Drop all further output to a terminal that has closed, where it would be an error."""
    for number in (1, 2):
        try:
            os.write(number, b"")
        except OSError:
            _discard(number)


def discard_output() -> None:
    """Drop what is still to be written, or the interpreter would complain of it at its exit."""
    with contextlib.suppress(ValueError):
        _discard(sys.stdout.fileno())


def _discard(stream: int) -> None:
    """Have all that is written to a stream, given by its number, go nowhere."""
    with contextlib.suppress(OSError):
        number = os.open(os.devnull, os.O_WRONLY)
        os.dup2(number, stream)
        os.close(number)


# Log lines on standard error that a loop never waits for.


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


# Verbosity of a verb: -v and -q, which may stand before the verb and after it.


def add_verbosity_arguments(
    parser: argparse.ArgumentParser, *, verbose: int | str, quiet: bool | str
) -> None:
    """Add -v and -q with their defaults; `argparse.SUPPRESS` leaves what an outer parser set."""
    parser.add_argument(
        "-v",
        "--verbose",
        action="count",
        default=verbose,
        help="print more; twice: all, with the traceback of an error",
    )
    parser.add_argument(
        "-q",
        "--quiet",
        action="store_true",
        default=quiet,
        help="print only errors, and the output of --json, --csv and the like",
    )


def add_verbosity_below(parser: argparse.ArgumentParser) -> None:
    """Add -v and -q to the parser of a verb, and to those of the words that may follow it."""
    add_verbosity_arguments(parser, verbose=argparse.SUPPRESS, quiet=argparse.SUPPRESS)
    for action in parser._actions:  # noqa: SLF001 - argparse has no other list of them
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001 - likewise
            for below in action.choices.values():
                add_verbosity_below(below)


# Garbage collection, put off while a verb is imported and its bench is built.


@contextlib.contextmanager
def collection_put_off(*, freezes: bool = False) -> Iterator[None]:
    """Collect nothing within the block.

    What is made there stays for the whole run, so looking through it again and again is in vain; it
    is a seventh of a start.

    Args:
        freezes: whether no later collection looks through it either, nor that at the end of the
            process; for a process that is the verb's own.

    Yields:
        Nothing.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if freezes:
            gc.freeze()
        if was_enabled:
            gc.enable()
