"""The files of a pack, and the versions of what made it."""

import contextlib
import hashlib
import importlib.metadata
import json
import multiprocessing
import os
import platform
import re
import shutil
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import can

import device_profiles
import hil_bench
from hil_bench.abilities.conformance import report
from hil_bench.abilities.conformance.check import Impact
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.eds_check import check_eds
from hil_bench.abilities.conformance.suite import Outcome, Result, run_suite
from hil_bench.abilities.conformance.wire import Wire
from hil_bench.bench.configuration import BenchConfig, load_config
from hil_bench.bench.virtual_bench import VirtualBench
from hil_bench.canopen_device.eds import load_eds
from hil_bench.devices.kinds.kind import NodeConfig
from hil_bench.devices.kinds.valve_408 import ValveConfig
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
        raise ConfigError(f"{folder}: there is no folder {folder.parent}; make it first")
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


# The checks of a pack that run the bench: conformance of its devices, and determinism.


# The conformance suite, run on each virtual CANopen device of a bench.

_PATIENCE = 0.5  # [s] of bench time, as `hil-bench conformance` has it
_UNCONFIGURED = 255


class Examination(NamedTuple):
    """The result of the suite on one device.

    Attributes:
        content: for a program.
        document: the report as Markdown; empty where the suite could not run.
    """

    content: dict[str, object]
    document: str


def examine_devices(config: BenchConfig) -> list[Examination]:
    """Run the suite on each device, each on a bench of its own, and return the results.

    The faults of the bench are left out: a broken device breaks clauses. Where a device keeps its
    parameters in a file, so are the checks that would overwrite them.
    """
    return [_examine(config.sound, node) for node in config.nodes]


def _examine(config: BenchConfig, node: NodeConfig) -> Examination:
    about = {"name": node.name, "node_id": node.node_id, "eds": node.eds.name}
    if node.node_id == _UNCONFIGURED:
        reason = "waits for LSS to give it a node-ID"
        return Examination({**about, "verdict": "not applicable", "detail": reason}, "")
    allowed = Impact.WRITE if any(each.storage for each in config.nodes) else Impact.STORE
    with VirtualBench(config) as bench:
        wire = Wire(bench.buses[node.bus], bench.now)
        objects = load_eds(node.eds, node.node_id)
        dut = DeviceUnderTest(wire, node.node_id, objects, _PATIENCE)
        results = list(run_suite(dut, allowed))
    counts = Counter(result.outcome for result in results)
    content = {
        **about,
        "verdict": "failed" if counts[Outcome.FAILED] else "passed",
        "allowed": allowed.name.lower(),
        "counts": {outcome.value: counts[outcome] for outcome in Outcome},
        "results": report.as_json(results),
    }
    return Examination(content, _document(node, results, allowed))


def _document(node: NodeConfig, results: list[Result], allowed: Impact) -> str:
    device = f"{node.name}, virtual, node {node.node_id}, {node.eds.name}"
    return report.markdown(results, device=device, allowed=allowed, eds=check_eds(node.eds))


# The same run again, in this process and in another: the same bytes?

_PERIODS = 100  # after one in which all boot
_PERIOD = 0.01  # [s]
_SETPOINTS = ((10, 0), (50, 0x2000), (60, 0), (100, -0x2000))
"""Set-point of each valve up to a period: rest, out at 50 %, stop, back."""


class Trace(NamedTuple):
    """The trace of a run.

    Attributes:
        digest: SHA-256 of all frames with their times and of all signals.
        frames: how many there were.
        rows: of the signals, a row a tick.
    """

    digest: str
    frames: int
    rows: int


def examine_determinism(config: BenchConfig) -> dict[str, object]:
    """Return the digests of three runs: two here, one in another process with its own hash seed."""
    seed, path = config.seed, config.path
    first, second = run_once(path, seed), run_once(path, seed)
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as other:
        third = other.submit(run_once, path, seed).result()
    places = ("this process", "this process, again", "another process")
    traces = (first, second, third)
    return {
        "verdict": "passed" if len(set(traces)) == 1 else "failed",
        "seed": seed,
        "length_s": _PERIODS * _PERIOD,
        "runs": [
            {"where": place, **trace._asdict()} for place, trace in zip(places, traces, strict=True)
        ],
    }


def run_once(path: Path | None, seed: int) -> Trace:
    """Run a bench for a second, its valves commanded by PDO, with a SYNC each 10 ms.

    Args:
        path: of its bench.toml; None for the built-in bench.
        seed: of all random generators.
    """
    config = load_config(path, seed=seed)
    valves = [(node.bus, node.node_id) for node in config.nodes if isinstance(node, ValveConfig)]
    with VirtualBench(config) as bench:
        bench.run(_PERIOD)  # all boot
        _send(bench.buses.values(), 0x000, b"\x01\x00")  # NMT: start all nodes
        for number in range(_PERIODS):
            setpoint = next(value for end, value in _SETPOINTS if number < end)
            command = (7).to_bytes(2, "little") + setpoint.to_bytes(2, "little", signed=True)
            for bus, node_id in valves:
                _send([bench.buses[bus]], 0x200 + node_id, command)
            _send(bench.buses.values(), 0x080, b"")  # SYNC
            bench.run(_PERIOD)
        digest = hashlib.sha256(repr([tuple(frame) for frame in bench.frames]).encode())
        digest.update(bench.signals.tobytes())
        return Trace(digest.hexdigest(), len(bench.frames), len(bench.signals))


def _send(buses: Iterable[can.BusABC], can_id: int, data: bytes) -> None:
    for bus in buses:
        bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
