"""The standard streams, however this process was started."""

import contextlib
import os
import sys

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
