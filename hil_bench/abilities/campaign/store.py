"""The store of a campaign on disk, and the identity of what made it."""

import hashlib
import json
import os
import shlex
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import hil_bench
from hil_bench.abilities.campaign.distributions import Point
from hil_bench.abilities.campaign.records import RunOutcome, RunResult, Verdict
from hil_bench.abilities.controllers.kinds import files_of
from hil_bench.abilities.scenario.records import Controller, Scenario
from hil_bench.bench.configuration import BenchConfig
from hil_bench.errors import ConfigError, about_file, printable

if TYPE_CHECKING:
    import pyarrow as pa


# The identity of a run as digests: program, bench, scenario, firmware, parameters, seed.
#
# No digest knows where a file lies, so that the same run has the same key on every machine.

_SOURCES = {".py", ".lark", ".eds", ".toml", ".tsv"}
_LENGTH = 32  # hexadecimal digits of a digest: 128 bits
_LEFT_OUT = {"path", "settings", "realtime"}
"""Of a bench: they change nothing in virtual time."""


@cache
def program_identity() -> str:
    """Return version and digest of the code that runs, as in ``0.1.0+5f2c9a01``."""
    digest = hashlib.sha256()
    for name in ("hil_bench", "hil_drivers", "device_profiles"):
        spec = find_spec(name)  # as text: who runs campaigns needs no driver
        root = Path(str(spec.origin if spec else "")).parent
        for path in sorted(each for each in root.rglob("*") if each.suffix in _SOURCES):
            digest.update(f"{root.name}/{path.relative_to(root)}".encode())
            digest.update(path.read_bytes())
    return f"{hil_bench.__version__}+{digest.hexdigest()[:8]}"


def case_digest(scenario: Scenario, config: BenchConfig, firmware: str) -> str:
    """Return the digest of all that decides what runs of a scenario find.

    Args:
        scenario: without regard to its parameters and its bench.
        config: its bench, as it is without tolerances.
        firmware: the digest of the firmware's files; empty for none.
    """
    plain = replace(scenario, parameters=(), bench=None, title="", requirement_ids=())
    return _digest([program_identity(), _plain(plain), _plain(config), firmware])


def run_key(case: str, parameters: Point, tolerances: Point, seed: int | None) -> str:
    """Return the key of a run.

    Args:
        case: the digest of its case.
        parameters: each in its own unit.
        tolerances: keys of the bench with their values.
        seed: of the bench; None for the bench's own.
    """
    return _digest([case, sorted(parameters.items()), sorted(tolerances.items()), seed])


def firmware_digest(words: Sequence[str]) -> str:
    """Return the digest of the files of a command line: the program, and files it names.

    Args:
        words: the command line; none gives an empty text.

    Raises:
        ConfigError: there is no such program.
    """
    if not words:
        return ""
    program = shutil.which(words[0])
    if program is None:
        raise ConfigError(f"{words[0]}: is no program that can be run; build it first")
    files = [Path(program), *(Path(word) for word in words[1:])]
    digests = [file_digest(each) if each.is_file() else str(each) for each in files]
    return _digest(digests)


def controller_digest(controller: Controller | None, folder: Path) -> str:
    """Return the digest of the files of a scenario's controller; empty for none.

    Args:
        controller: of the scenario.
        folder: of the scenario's file, from which a kind's paths count.
    """
    if controller is None or controller.example:
        return ""
    if controller.firmware:
        return firmware_digest(controller.firmware)
    place = folder / str(controller.table.get("folder", "."))
    return _digest([file_digest(each) for each in files_of(controller.table, place)])


def file_digest(path: Path) -> str:
    """Return the digest of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:_LENGTH]


def _digest(value: object) -> str:
    text = json.dumps(value, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:_LENGTH]


def _plain(value: object) -> object:
    """Convert a value to one that JSON can hold; a file becomes the digest of its content."""
    plain: object
    match value:
        case Enum():
            plain = str(value.value)
        case None | bool() | str() | int():
            plain = value
        case float():
            plain = repr(value)
        case Path():
            plain = file_digest(value) if value.is_file() else value.name
        case Mapping():
            plain = [[_plain(key), _plain(each)] for key, each in value.items()]
        case list() | tuple():
            plain = [_plain(each) for each in value]
        case set() | frozenset():
            plain = sorted(json.dumps(_plain(each)) for each in value)
        case np.ndarray():
            plain = [repr(each) for each in value.ravel().tolist()]
        case _ if is_dataclass(value):
            left_out = _LEFT_OUT if isinstance(value, BenchConfig) else set()
            named = (each.name for each in fields(value) if each.compare)
            plain = [[name, _plain(getattr(value, name))] for name in named if name not in left_out]
        case _:
            kind = type(value)
            plain = f"{kind.__module__}.{kind.__qualname__} {getattr(value, 'name', '')}"
    return plain


# The results of a campaign in a folder: Parquet files, each written whole or not at all.

_PROGRAM = b"hil-bench"
_FIRMWARE = b"firmware:"
_GIVEN = b"set"
_MOST_ROWS = 100_000
"""Of one file; a campaign begins the next one after far fewer runs."""


class Store:
    """The results of a campaign.

    Args:
        folder: where they are; made where it is missing.
        firmware: the digest of each firmware by its name.
        given: values of parameters that the campaign was given with --set.

    Raises:
        ConfigError: the folder cannot be made.
    """

    def __init__(
        self, folder: Path, firmware: Mapping[str, str], given: Mapping[str, float] | None = None
    ) -> None:
        self.folder = folder
        self._firmware = dict(firmware)
        self._given = set_words(given or {})
        with about_file(folder, what="cannot be made"):
            folder.mkdir(parents=True, exist_ok=True)
        self._remove_halves()

    def write(self, results: Sequence[RunResult]) -> None:
        """Write results to a file of their own.

        A `ConfigError` says why it cannot be written; those written before are there.
        """
        import pyarrow.parquet as pq  # noqa: PLC0415 - an extra, and slow to import

        if not results:
            return
        rows = sorted(results)
        name = hashlib.sha256("".join(row.key for row in rows).encode()).hexdigest()[:16]
        path, half = self.folder / f"{name}.parquet", self.folder / f".{name}.{os.getpid()}.half"
        meta = {_PROGRAM: program_identity().encode()}
        meta[_GIVEN] = shlex.join(self._given).encode()
        meta |= {_FIRMWARE + k.encode(): v.encode() for k, v in self._firmware.items()}
        table = _to_table(rows).replace_schema_metadata(meta)
        kept = "all earlier runs are kept, and the same command goes on from there"
        with about_file(self.folder, right=kept):
            try:
                with half.open("wb") as file:
                    pq.write_table(table, file, compression="zstd")
                    file.flush()
                    os.fsync(file.fileno())
                half.replace(path)
            finally:
                with suppress(OSError):
                    half.unlink(missing_ok=True)

    def keys(self) -> set[str]:
        """Return the keys of all runs that are done."""
        found = set[str]()
        for path in self._files():
            table = self._read(path, ["key"])
            with _about_rows(path):
                found.update(table["key"].to_pylist())
        return found

    def results(self, *, is_foreign: bool = False) -> Iterator[RunResult]:
        """Yield all results, file by file; one that is there twice comes twice.

        Args:
            is_foreign: whether another version of hil-bench may have made them.
        """
        for path in self._files():
            table = self._read(path, is_foreign=is_foreign)
            with _about_rows(path):
                results = [_from_row(row) for row in table.to_pylist()]
            yield from results

    def _files(self) -> list[Path]:
        return sorted(self.folder.rglob("*.parquet"))

    def _read(
        self, path: Path, columns: list[str] | None = None, *, is_foreign: bool = False
    ) -> "pa.Table":
        import pyarrow as pa  # noqa: PLC0415 - an extra, and slow to import
        import pyarrow.parquet as pq  # noqa: PLC0415

        try:
            # Arrow's own file: a thread of Arrow that releases what it has read of one of Python's
            # needs the interpreter, which may have ended by then, and aborts the process.
            with pa.OSFile(str(path)) as file:
                parquet = pq.ParquetFile(file)
                meta = parquet.schema_arrow.metadata or {}
                if parquet.metadata.num_rows > _MOST_ROWS:
                    rows = f"{parquet.metadata.num_rows} rows"
                    raise ConfigError(
                        f"{path}: has {rows}, and a result of a campaign at most"
                        f" {_MOST_ROWS}; take it out of the folder"
                    )
                if not is_foreign:
                    self._check_origin(path, meta)
                return parquet.read(columns)
        except (OSError, UnicodeDecodeError, pa.ArrowException) as error:
            right = "remove it, and its runs are done again"
            first = str(error).splitlines()[0]
            raise ConfigError(f"{path}: cannot be read: {first}; {right}") from None

    def _check_origin(self, path: Path, meta: Mapping[bytes, bytes]) -> None:
        program = meta.get(_PROGRAM, b"").decode(errors="replace")
        if not program:
            raise ConfigError(f"{path}: is no result of a campaign; take it out of the folder")
        if program != program_identity():
            wrong = f"comes from hil-bench {program}, and this is {program_identity()}"
            right = "use one version for all, or another --output"
            raise ConfigError(f"{path}: {wrong}; {right}")
        given, here = meta.get(_GIVEN, b"").decode(errors="replace"), shlex.join(self._given)
        if given != here:
            wrong = f"comes from a campaign with {given or 'no --set'}, and this has"
            right = "give the same, or another --output"
            raise ConfigError(f"{path}: {wrong} {here or 'none'}; {right}")
        for name, digest in self._firmware.items():
            other = meta.get(_FIRMWARE + name.encode())
            if other is not None and other.decode(errors="replace") != digest:
                wrong = f"comes from another build of the firmware {name!r} ({other.decode()[:8]})"
                right = f"here it is {digest[:8]}; take one build to all machines, or another"
                raise ConfigError(f"{path}: {wrong}; {right} --output")

    def _remove_halves(self) -> None:
        """Remove what a process that was killed has left."""
        for path in self.folder.glob(".*.half"):
            with suppress(OSError, ValueError):
                if not _runs(int(path.suffixes[-2][1:])):
                    path.unlink()


@contextmanager
def _about_rows(path: Path) -> Iterator[None]:
    """Name the file where a row of it is no result.

    Yields:
        Nothing.

    Raises:
        ConfigError: it is so.
    """
    try:
        yield
    except (KeyError, TypeError, ValueError) as error:
        wrong = f"has a row that is no result of a campaign ({printable(str(error))})"
        raise ConfigError(f"{path}: {wrong}; remove it, and its runs are done again") from None


def same_finding(one: RunResult, other: RunResult) -> bool:
    """Return True if two results of a run agree; the last words of firmware name ports."""
    return one._replace(problem="") == other._replace(problem="")


def set_words(given: Mapping[str, float]) -> list[str]:
    """Return values of parameters as words of a command line."""
    return [f"--set={name}={value!r}" for name, value in sorted(given.items())]


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def _to_table(results: Sequence[RunResult]) -> "pa.Table":
    import pyarrow as pa  # noqa: PLC0415 - an extra, and slow to import

    verdict = pa.struct(
        [
            ("id", pa.string()),
            ("outcome", pa.string()),
            ("margin", pa.float64()),
            ("reason", pa.string()),
            ("seen", pa.float64()),
        ]
    )
    schema = pa.schema(
        [
            ("key", pa.string()),
            ("scenario", pa.string()),
            ("bench", pa.string()),
            ("firmware", pa.string()),
            ("seed", pa.int64()),
            ("values", pa.map_(pa.string(), pa.float64())),
            ("outcome", pa.string()),
            ("problem", pa.string()),
            ("duration", pa.float64()),
            ("verdicts", pa.list_(verdict)),
        ]
    )
    rows = [
        {
            **each._asdict(),
            "outcome": each.outcome.value,
            "values": sorted(each.values.items()),
            "verdicts": [one._asdict() for one in each.verdicts],
        }
        for each in results
    ]
    return pa.Table.from_pylist(rows, schema=schema)


def _from_row(row: dict[str, Any]) -> RunResult:
    values = dict(row.pop("values"))
    verdicts = tuple(Verdict(**each) for each in row.pop("verdicts"))
    outcome = RunOutcome(str(row.pop("outcome")))
    return RunResult(**row, values=values, outcome=outcome, verdicts=verdicts)
