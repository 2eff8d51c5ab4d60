"""The files of a pack, and the versions of what made it."""

import contextlib
import hashlib
import importlib.metadata
import json
import os
import platform
import re
import shutil
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path

import device_profiles
import hil_bench
from hil_bench.bench.configuration import BenchConfig
from hil_bench.errors import ConfigError, about_file

# The software that made a pack: versions, and digests of all that could change a result.

_NAME = re.compile(r"[A-Za-z0-9._-]+")


def examine_software(config: BenchConfig) -> dict[str, object]:
    """Return versions of hil-bench, Python and the libraries, and digests of code and inputs."""
    inputs = [{"file": path.name, "sha256": sha256_of(path)} for path in _inputs(config)]
    return {
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "hil-bench": hil_bench.__version__,
        "code": {
            "hil_bench": _tree_digest(Path(hil_bench.__file__).parent),
            "device_profiles": _tree_digest(Path(device_profiles.__file__).parent),
        },
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "system": platform.platform(),
        "processor": platform.machine(),
        "libraries": dict(_libraries()),
        "bench": config.path.name if config.path else "built-in bench",
        "seed": config.seed,
        "inputs": inputs,
    }


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _inputs(config: BenchConfig) -> list[Path]:
    """Return bench.toml and the EDS files, each once."""
    files = [config.path] if config.path else []
    return list(dict.fromkeys([*files, *(node.eds for node in config.nodes)]))


def _libraries() -> Iterator[tuple[str, str]]:
    """Yield the direct dependencies that are installed, those of the extras too."""
    names = {_NAME.match(text) for text in importlib.metadata.requires("hil-bench") or ()}
    for name in sorted({match[0].lower() for match in names if match} - {"hil-bench"}):
        try:
            yield name, importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue


def _tree_digest(folder: Path) -> str:
    """Return one SHA-256 of all files of an installed package, their names too."""
    whole = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            whole.update(f"{path.relative_to(folder).as_posix()}\n{sha256_of(path)}\n".encode())
    return whole.hexdigest()


# A pack on disk: written whole or not at all, and checked offline.

MANIFEST = "manifest.json"
"""Name of the file that has the digests of all others."""

_FORMAT = 1
_MOST_BYTES = 10_000_000  # of a manifest


def check_folder(folder: Path) -> None:
    """Refuse a folder that a pack cannot become.

    Raises:
        ConfigError: it is not empty, no folder, or nothing can be made beside it.
    """
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise ConfigError(f"{folder}: is no folder; give the name of a new one")
    if folder.is_dir() and any(folder.iterdir()):
        raise ConfigError(f"{folder}: is not empty; give the name of a new folder")
    if not folder.absolute().parent.is_dir():
        raise ConfigError(f"{folder}: there is no folder {folder.absolute().parent}")
    with about_file(folder):
        partial = _partial(folder.absolute())
        partial.mkdir()
        partial.rmdir()


def write_pack(folder: Path, files: Mapping[str, bytes]) -> str:
    """Write all files and the manifest, or nothing; return the SHA-256 of the manifest.

    A folder that cannot be written is a `ConfigError`.

    Args:
        folder: that `check_folder` takes.
        files: the contents by their names, with ``/`` between folders.
    """
    check_folder(folder)
    whole = folder.absolute()
    partial = _partial(whole)
    manifest = _manifest(files)
    with about_file(folder), _removed_unless_renamed(partial):
        for name, content in {**files, MANIFEST: manifest}.items():
            path = partial / name
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(content)
        if whole.is_dir():
            whole.rmdir()  # empty, or this fails
        partial.rename(whole)
    return hashlib.sha256(manifest).hexdigest()


def _partial(whole: Path) -> Path:
    """Return the folder that becomes the pack once it is whole."""
    return whole.with_name(f".{whole.name}.{os.getpid()}.partial")


@contextlib.contextmanager
def _removed_unless_renamed(partial: Path) -> Iterator[None]:
    """Make a folder that is gone at the end, by its new name or for good.

    Yields:
        Nothing.
    """
    partial.mkdir()
    try:
        yield
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _manifest(files: Mapping[str, bytes]) -> bytes:
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    content = {"pack": "hil-bench evidence", "format": _FORMAT, "files": digests}
    return (json.dumps(content, indent=2, sort_keys=True) + "\n").encode()


def verify_pack(folder: Path, digest: str | None = None) -> list[str]:
    """List the differences from the manifest, a line a file; empty without any.

    Only files that the folder holds are opened, whatever the manifest names.

    Args:
        folder: of a pack.
        digest: the manifest's own SHA-256, where it was kept elsewhere.

    Raises:
        ConfigError: there is no such folder, or a file cannot be read.
    """
    if not folder.is_dir():
        raise ConfigError(f"{folder}: is no folder; give that of an evidence pack")
    try:
        there = dict(_digests(folder))
        expected = _read_manifest(folder, digest)
    except OSError as error:
        raise ConfigError(f"{error.filename}: cannot be read: {error.strerror}") from None
    if isinstance(expected, str):
        return [expected]
    there.pop(MANIFEST, None)
    lines = [f"{name}: is missing" for name in expected.keys() - there.keys()]
    lines += [f"{name}: was added" for name in there.keys() - expected.keys()]
    lines += [
        f"{name}: was changed"
        for name in expected.keys() & there.keys()
        if expected[name] != there[name]
    ]
    return sorted(lines)


def _digests(folder: Path) -> Iterator[tuple[str, str]]:
    """Yield name and SHA-256 of each file; what is no regular file has none, and differs."""
    for path in folder.rglob("*"):
        name = path.relative_to(folder).as_posix()
        if path.is_symlink() or not (path.is_file() or path.is_dir()):
            yield name, "not a regular file"
        elif path.is_file():
            yield name, sha256_of(path)


def _read_manifest(folder: Path, digest: str | None) -> dict[str, str] | str:
    """Return the digests by name, or what is wrong with the manifest."""
    path = folder / MANIFEST
    if path.is_symlink() or not path.is_file():
        return f"{MANIFEST}: is missing"
    if path.stat().st_size > _MOST_BYTES:
        return f"{MANIFEST}: was changed: it is too large"
    content = path.read_bytes()
    if digest is not None and hashlib.sha256(content).hexdigest() != digest.lower():
        return f"{MANIFEST}: was changed: its SHA-256 is not the one that was given"
    try:
        manifest = json.loads(content)
    except (ValueError, RecursionError):
        manifest = None
    files = manifest.get("files") if isinstance(manifest, dict) else None
    if not isinstance(files, dict) or manifest.get("format") != _FORMAT:
        return f"{MANIFEST}: was changed: it is no manifest of this version"
    return {str(name): str(value) for name, value in files.items()}
