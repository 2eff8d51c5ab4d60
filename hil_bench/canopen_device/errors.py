"""Errors of a CANopen device.

Each is also the builtin that it is, so that a caller may catch either::

    DeviceError
     ├── ConfigError (ValueError)   a file, an argument or a value is wrong
     │    └── EdsError              an EDS file cannot serve as a device
     ├── StorageError (OSError)     stored parameters could not be read or written
     └── SdoAbort                   an access to an object was refused, with its abort code
"""


def printable(text: str) -> str:
    """Return a text from outside as a terminal may have it: control characters escaped."""
    return "".join(char if char.isprintable() else ascii(char)[1:-1] for char in text)


class DeviceError(Exception):
    """Base of every error that is raised on purpose; its message may quote anything."""

    def __str__(self) -> str:
        return "\n".join(map(printable, super().__str__().split("\n")))


class ConfigError(DeviceError, ValueError):
    """A file, an argument or a value is wrong; the message says what, where, what is right."""


class EdsError(ConfigError):
    """An EDS file is missing, malformed or lacks what its device profile needs."""


class StorageError(DeviceError, OSError):
    """Stored parameters of a device could not be read or written, or are damaged."""


class SdoAbort(DeviceError):  # noqa: N818 - the standard's word
    """An access to an object was refused.

    Attributes:
        code: the abort code, 32 bit (CiA 301, SDO abort codes).
        text: the standard's words for that code.
    """

    def __init__(self, code: int, text: str) -> None:
        super().__init__(f"SDO abort 0x{code:08X}: {text}")
        self.code = code
        self.text = text
