"""Errors of the bench side, one tree.

Each error is also the builtin that it is, so that a caller may catch either::

    HilBenchError
     ├── ConfigError (ValueError)   a file, an argument or a value is wrong: exit code 2
     │    ├── ParameterError        a plant parameter or state makes no sense
     │    └── EdsError              an EDS file cannot serve as a device
     ├── BusError (OSError)         a bus or port could not be opened, or was lost: exit code 3
     ├── TimingError               a tick took too long, and the loop is to stop then: exit code 4
     ├── RecordingError (OSError)   a recording could not be written on
     ├── StorageError (OSError)     stored parameters could not be read or written
     ├── WaitTimeoutError (TimeoutError)  a condition was not met in bench time
     ├── ControllerError (RuntimeError)   the controller of a bench has ended or is silent
     └── SdoAbort                   an access to an object was refused, with its CiA 301 abort code

The controller side has a tree of its own, in `drivers.errors`.
"""


class HilBenchError(Exception):
    """Base of every error that the bench raises on purpose."""


class ConfigError(HilBenchError, ValueError):
    """A file, an argument or a value is wrong; the message says what, where, what is right."""


class ParameterError(ConfigError):
    """A plant parameter, input or state makes no physical sense; the message names it."""


class EdsError(ConfigError):
    """An EDS file is missing, malformed or lacks what its device profile needs."""


class BusError(HilBenchError, OSError):
    """A CAN bus or a port could not be opened, or was lost."""


class TimingError(HilBenchError):
    """A tick of a paced loop took longer than its period, and the loop is to stop then."""


class RecordingError(HilBenchError, OSError):
    """A recording could not be written on: the disk is full, or its folder has vanished."""


class StorageError(HilBenchError, OSError):
    """Stored parameters of a device could not be read or written, or are damaged."""


class WaitTimeoutError(HilBenchError, TimeoutError):
    """A condition was not met within the bench time that it was given."""


class ControllerError(HilBenchError, RuntimeError):
    """The program that controls a bench has ended or says nothing, so bench time stands still."""


class SdoAbort(HilBenchError):  # noqa: N818 - the standard's word
    """An access to an object was refused.

    Attributes:
        code: the abort code, 32 bit (CiA 301, SDO abort codes).
        text: the standard's words for that code.
    """

    def __init__(self, code: int, text: str) -> None:
        super().__init__(f"SDO abort 0x{code:08X}: {text}")
        self.code = code
        self.text = text


def printable(text: str) -> str:
    """Return a text from outside as a terminal may have it: control characters escaped."""
    return "".join(char if char.isprintable() else ascii(char)[1:-1] for char in text)
