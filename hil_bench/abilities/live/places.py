"""The places where benches are found, and the options that name one."""

import argparse
import contextlib
import importlib.util
import os
import re
import socket
import stat
import tempfile
from pathlib import Path
from typing import IO

from hil_bench.errors import BusError, ConfigError

# The place of running benches' sockets: a folder of the user's own.
#
# It is ``$XDG_RUNTIME_DIR/hil-bench``, or ``hil-bench-UID`` in the folder for temporary files. Each
# bench has a socket there, ``NAME.sock``. The folder has the permissions 0700, a socket 0600.


HAS_SOCKETS = hasattr(socket, "AF_UNIX") and hasattr(os, "getuid")
"""Whether this machine has Unix sockets, and users."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,39}")
_MOST_PATH = 107  # bytes that Linux has for it
_BACKLOG = 64
_SUFFIX = ".sock"


def runtime_folder() -> Path:
    """Return the folder of the sockets, whether it is there or not."""
    folder = os.environ.get("XDG_RUNTIME_DIR", "")
    if folder and Path(folder).is_dir():
        return Path(folder) / "hil-bench"
    return Path(tempfile.gettempdir()) / f"hil-bench-{os.getuid()}"


def check_name(name: str) -> str:
    """Return the name of a bench.

    Raises:
        ConfigError: it cannot be one.
    """
    if not _NAME.fullmatch(name):
        raise ConfigError(
            f"bench name {name!a}: give up to 40 letters, digits, _, . or -, a letter or a "
            "digit first"
        )
    return name


def place_of(name: str) -> Path:
    """Return the path of the socket of a bench; `ConfigError` where the name cannot be one."""
    return runtime_folder() / f"{check_name(name)}{_SUFFIX}"


def name_of(path: Path) -> str:
    """Return the name of the bench of a socket."""
    return path.name.removesuffix(_SUFFIX)


class Place:
    """The socket of a bench that runs, and its name; they are held until `release`.

    A lock on a file beside the socket says that the bench runs: it goes with the process, however
    that ends, and asking for it disturbs nobody.

    Args:
        name: of the bench.

    Attributes:
        name: as passed in.
        listener: the listening socket.

    Raises:
        ConfigError: the name cannot be one, or a bench that runs has it.
        BusError: the folder or the socket cannot be made.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._path = place_of(name)
        _open_folder(self._path.parent)
        if len(os.fsencode(self._path)) > _MOST_PATH:
            text = f"{self._path}: longer than {_MOST_PATH} bytes; set XDG_RUNTIME_DIR shorter"
            raise BusError(text)
        lock = _take_lock(self._path)
        if lock is None:
            raise ConfigError(f'a bench with the name "{name}" runs already; give another name')
        self._lock = lock
        self.listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._path.unlink(missing_ok=True)  # what a killed bench has left
            self.listener.bind(str(self._path))
            self._path.chmod(0o600)
            self.listener.listen(_BACKLOG)
        except OSError as error:
            self.release()
            raise BusError(f"{self._path}: {error.strerror or error}") from error
        self.listener.setblocking(False)

    def release(self) -> None:
        """Close the socket, and give the name free."""
        self.listener.close()
        with contextlib.suppress(OSError):
            self._path.unlink(missing_ok=True)
        self._lock.close()


def find_names() -> list[str]:
    """Return the names of the benches that run."""
    folder = runtime_folder()
    try:
        check_folder(folder)
        return [name_of(path) for path in sorted(folder.glob(f"*{_SUFFIX}")) if is_held(path)]
    except (BusError, FileNotFoundError):
        return []


def where_looked() -> str:
    """Return the place where benches were looked for, or why none is found there.

    Another user, or another session without XDG_RUNTIME_DIR, has another one.
    """
    folder = runtime_folder()
    try:
        check_folder(folder)
    except BusError as error:
        return str(error)
    except FileNotFoundError:
        pass
    return f"looked in {folder}"


def is_held(path: Path) -> bool:
    """Return True if the bench of a socket runs."""
    lock = _take_lock(path, is_shared=True)
    if lock is None:
        return True
    lock.close()
    return False


def _take_lock(path: Path, *, is_shared: bool = False) -> IO[bytes] | None:
    """Return the lock of a socket, held until it is closed; None where a bench holds it.

    Args:
        path: of the socket.
        is_shared: only look, so that two who look do not take each other for the bench.

    Raises:
        BusError: it cannot be made.
    """
    import fcntl  # noqa: PLC0415 - Windows has none, nor a feed

    lock = path.with_suffix(".lock")
    try:
        file = lock.open("ab")
    except OSError as error:
        raise BusError(f"{lock}: {error.strerror or error}") from error
    try:
        fcntl.flock(file, (fcntl.LOCK_SH if is_shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        return None
    return file


def check_folder(folder: Path) -> None:
    """Check that a folder is this user's, and nobody else's.

    Raises:
        BusError: it is not; `FileNotFoundError` where it is not there.
    """
    found = folder.lstat()
    if (
        not stat.S_ISDIR(found.st_mode)
        or found.st_uid != os.getuid()
        or stat.S_IMODE(found.st_mode) & 0o077
    ):
        raise BusError(f"{folder}: must be a folder that only its owner may enter (0700)")


def _open_folder(folder: Path) -> None:
    try:
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        check_folder(folder)
    except BusError:
        raise
    except OSError as error:
        raise BusError(f"{folder}: {error.strerror or error}") from error


# The options of `hil-bench run` for those who watch.


NAME = "bench"
"""Name of a bench without `--name`."""

EXAMPLES = {
    "run": """\
  hil-bench run -i socketcan -c vcan0 --panel
                                       with a web page to watch and break it
"""
}


def add_options(parser: argparse.ArgumentParser, often: "argparse._ActionsContainer") -> None:
    """Add what concerns those who watch the bench, --panel to the group `often`."""
    group = parser.add_argument_group("watching")
    group.add_argument(
        "--name",
        metavar="NAME",
        help="name by which hil-bench watch, hil-bench ctl and hil_bench.attach() find this bench "
        f"(default {NAME}, {NAME}-2, ...)",
    )
    group.add_argument(
        "--no-feed", action="store_true", help="let nobody watch this bench or give it commands"
    )
    often.add_argument(
        "--panel",
        action="store_true",
        help="serve the web page of hil-bench panel, too, in a process of its own",
    )


def check_options(args: argparse.Namespace) -> None:
    """Refuse what cannot be meant.

    Raises:
        ConfigError: it says which option and what would be right.
    """
    if not args.panel:
        return
    if args.no_feed or not HAS_SOCKETS:
        why = "--no-feed" if args.no_feed else "this machine has no Unix sockets"
        raise ConfigError(f"--panel: needs the feed, which is off ({why}); leave one out")
    check_panel_argument()


def check_panel_argument() -> None:
    """Refuse --panel where it cannot be.

    Raises:
        ConfigError: its libraries are missing.
    """
    if importlib.util.find_spec("uvicorn") is None or importlib.util.find_spec("starlette") is None:
        raise ConfigError("--panel needs an extra; pip install 'hil-bench[panel]'")
