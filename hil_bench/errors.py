"""Errors of the bench side, one tree.

Each error is also the builtin that it is, so that a caller may catch either::

    HilBenchError
     ├── ConfigError (ValueError)   a file, an argument or a value is wrong: exit code 2
     │    ├── DiskError             the disk under a file is full or broken: exit code 5
     │    ├── ControllerFileError   the program of a controller is missing or of another kind;
     │    │                         also a ControllerError
     │    ├── ParameterError        a plant parameter or state makes no sense
     │    └── EdsError              an EDS file cannot serve as a device
     ├── NothingSeenError          a recording is empty, so nothing can be said of it: exit code 6
     ├── BusError (OSError)         a bus or port could not be opened, or was lost: exit code 3
     ├── TimingError               a tick took too long, and the loop is to stop then: exit code 4
     ├── RecordingError (OSError)   a recording could not be written on: exit code 5
     ├── StorageError (OSError)     stored parameters could not be read or written
     ├── WaitTimeoutError (TimeoutError)  a condition was not met in bench time: exit code 3
     ├── ControllerError (RuntimeError)   the controller of a bench is silent: exit code 3
     └── SdoAbort                   an access to an object was refused, with its CiA 301 abort code

`hil_bench.canopen_device`, which knows nothing of the bench, has those that a device by itself may
raise, and their base, which is this tree's. The controller side has a tree of its own, in
`hil_drivers.errors`.
"""

import contextlib
import errno
import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path

from hil_bench.canopen_device.errors import (
    ConfigError,
    DeviceError,
    EdsError,
    SdoAbort,
    StorageError,
    printable,
)

__all__ = [
    "DISK_FAULTS",
    "BusError",
    "ConfigError",
    "ControllerError",
    "ControllerFileError",
    "DiskError",
    "EdsError",
    "HilBenchError",
    "NothingSeenError",
    "ParameterError",
    "RecordingError",
    "SdoAbort",
    "StorageError",
    "TimingError",
    "WaitTimeoutError",
    "about_file",
    "printable",
]

HilBenchError = DeviceError

DISK_FAULTS = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO})
"""Error numbers of a disk that is full or broken: no other file name helps."""


class DiskError(ConfigError):
    """The disk under a file is full or broken."""


class ParameterError(ConfigError):
    """A plant parameter, input or state makes no physical sense; the message names it.

    Attributes:
        symbols: what it is about, the wrong one first; none where it is no parameter.
    """

    def __init__(self, message: str, *symbols: str) -> None:
        super().__init__(message)
        self.symbols = symbols


class NothingSeenError(HilBenchError):
    """A recording that is to be looked at holds nothing."""


class BusError(HilBenchError, OSError):
    """A CAN bus or a port could not be opened, or was lost."""


class TimingError(HilBenchError):
    """A tick of a paced loop took longer than its period, and the loop is to stop then."""


class RecordingError(HilBenchError, OSError):
    """A recording could not be written on: the disk is full, or its folder has vanished."""


class WaitTimeoutError(HilBenchError, TimeoutError):
    """A condition was not met within the bench time that it was given."""


class ControllerError(HilBenchError, RuntimeError):
    """The program that controls a bench has ended or says nothing, so bench time stands still."""


class ControllerFileError(ConfigError, ControllerError):
    """A controller cannot begin: its file is missing or of another kind, or what it needs here."""


@contextlib.contextmanager
def about_file(path: object, *, what: str = "cannot be written", right: str = "") -> Iterator[None]:
    """Have an `OSError` of the block come as a `ConfigError` that names the file.

    Args:
        path: the file, as messages name it.
        what: cannot be done.
        right: what would be right, where that is worth saying.

    Yields:
        Nothing.

    Raises:
        ConfigError: in the place of the `OSError`.
        DiskError: likewise, where the disk is full or broken.
    """
    try:
        yield
    except OSError as error:
        folder = Path(error.filename or ".").parent
        if what == "cannot be written" and error.errno == errno.ENOENT and not folder.exists():
            raise ConfigError(f"{path}: there is no folder {folder}; make it first") from None
        reason = error.strerror or type(error).__name__
        text = "; ".join(filter(None, (f"{path}: {what}: {reason}", right)))
        if error.errno in DISK_FAULTS:
            raise DiskError(text) from None
        raise ConfigError(text) from None


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Have an `OSError` of the block name the file: one of a full disk does not by itself.

    Yields:
        Nothing.

    Raises:
        OSError: that of the block.
    """
    try:
        yield
    except OSError as error:
        error.filename = error.filename or str(path)
        raise


_LONGEST_HEAD = 1 << 20
_MDF_BY_US = rb"(?s)(MDF     |UnFinMF ).{8}hilbench"
_OURS = {
    ".asc": rb"date ",
    ".blf": rb"LOGG",
    ".cdcf": rb"(?s)..\0\0",
    ".csv": rb"time\b",
    ".dbc": rb'VERSION "hil-bench"',
    ".html": rb"(?si)<!doctype html>.*hil-bench",
    ".json": rb"\s*[\[{]",
    ".log": rb"\(",
    ".md": rb"(?s)# (CANopen conformance report|.*(hil-bench|\n## Steps\n))",
    ".mf4": _MDF_BY_US,
    ".pdf": rb"%PDF",
    ".png": rb"\x89PNG",
    ".py": rb'(?s)""".{0,500}hil-bench',
    ".svg": rb"<\?xml|<svg",
    ".toml": rb"# .{0,500}hil-bench",
    ".xml": rb"<\?xml|<testsuite",
}
"""How files begin that the bench replaces, by suffix: those that it writes itself. Pictures, bus
logs, tables of signals, concise DCFs, JSON and JUnit files are known by their kind alone."""


def check_replaceable(path: Path) -> None:
    """Refuse to replace a file that the bench has not written.

    Raises:
        ConfigError: there is one of another content.
    """
    form = _OURS.get(path.suffix.lower())
    if form is None or not path.is_file():
        return
    with about_file(path, what="cannot be replaced"), path.open("rb") as file:
        head = file.read(_LONGEST_HEAD)
    if head and not re.match(form, head):
        right = "give another name, or delete it first"
        raise ConfigError(f"{path}: is there already, and not written by hil-bench; {right}")


def first_line(error: BaseException) -> str:
    """Return the first line of an error, without the traceback that some buses put into it."""
    text = str(error).partition("Traceback (most recent call last)")[0]
    return (text.splitlines() or [type(error).__name__])[0].strip()


def require_extra(package: str, what: str, extra: str = "analysis") -> None:
    """Refuse to go on without an optional package.

    Args:
        package: the package's name.
        what: needs it, as in ``"a figure"``.
        extra: of the distribution, that has it.

    Raises:
        ConfigError: it is not installed.
    """
    if importlib.util.find_spec(package) is None:
        raise ConfigError(
            f"{what} needs {package}; install it with: pip install 'hil-bench[{extra}]'"
        )
