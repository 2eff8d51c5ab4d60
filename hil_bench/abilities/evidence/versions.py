"""The software that made a pack: versions, and digests of all that could change a result."""

import hashlib
import importlib.metadata
import platform
import re
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import device_profiles
import hil_bench
from hil_bench.bench.configuration import BenchConfig

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
