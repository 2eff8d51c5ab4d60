"""The file of an FMU: a zip from anywhere, which is unpacked only where it is one."""

import stat
import sys
import zipfile
from pathlib import Path, PurePosixPath
from typing import Final

from hil_bench.errors import ConfigError

LARGEST: Final = 2 << 30
"""Of the unpacked files [bytes]: beyond it, it is a bomb rather than a model."""

_MOST_FILES: Final = 100_000


def check_archive(path: Path) -> None:
    """Refuse what is no FMU, or would write beside its own folder, by a `ConfigError`."""
    with _open(path) as archive:
        _check_members(path, archive)


def unpack(path: Path, folder: Path) -> None:
    """Unpack an FMU into a folder.

    Raises:
        ConfigError: it is none, is damaged, or does not fit.
    """
    with _open(path) as archive:
        _check_members(path, archive)
        try:
            archive.extractall(folder)
        except (zipfile.BadZipFile, OSError, EOFError, NotImplementedError, RuntimeError) as error:
            raise ConfigError(f"{path}: cannot be unpacked: {error}") from None


def _open(path: Path) -> zipfile.ZipFile:
    try:
        return zipfile.ZipFile(path)
    except zipfile.BadZipFile:
        raise ConfigError(f"{path}: is no FMU: it is not a zip file") from None
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise ConfigError(f"{path}: cannot be read: {reason}; give an FMU") from None


def _check_members(path: Path, archive: zipfile.ZipFile) -> None:
    members = archive.infolist()
    names = {member.filename for member in members}
    if "modelDescription.xml" not in names:
        raise ConfigError(f"{path}: is no FMU: it has no modelDescription.xml")
    for member in members:
        parts = PurePosixPath(member.filename).parts
        is_outside = member.filename.startswith("/") or ".." in parts
        if is_outside or "\\" in member.filename or ":" in member.filename:
            wrong = f"{member.filename!r} would be written outside of it"
            raise ConfigError(f"{path}: {wrong}; such a file is no FMU")
        if stat.S_ISLNK(member.external_attr >> 16):
            raise ConfigError(f"{path}: {member.filename!r} is a link; such a file is no FMU")
    size = sum(member.file_size for member in members)
    if size > LARGEST or len(members) > _MOST_FILES:
        most = f"{LARGEST >> 30} GB in {_MOST_FILES} files"
        raise ConfigError(
            f"{path}: unpacks to {size} bytes in {len(members)} files; {most} is most"
        )


def platforms(path: Path) -> list[str]:
    """Return the platforms for which an FMU has binaries, as FMI names them."""
    with _open(path) as archive:
        parts = (PurePosixPath(name).parts for name in archive.namelist())
        found = {part[1] for part in parts if len(part) > 2 and part[0] == "binaries"}
    return sorted(found)


def library_of(path: Path, identifier: str, names: tuple[str, ...]) -> PurePosixPath:
    """Return the library of an FMU for this machine, within the archive.

    Args:
        path: the FMU.
        identifier: of its model.
        names: those that this machine has as a platform.

    Raises:
        ConfigError: it is for another platform.
    """
    suffix = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
    with _open(path) as archive:
        known = set(archive.namelist())
    for name in names:
        library = PurePosixPath("binaries", name, identifier + suffix)
        if str(library) in known:
            return library
    has = ", ".join(platforms(path)) or "none: it has sources alone"
    raise ConfigError(f"{path}: is for another platform: {has}; {' or '.join(names)} is right here")
