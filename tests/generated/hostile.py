"""Binary files of other tools and of ours: sound ones, and bombs.

A bomb is a small file that claims, or unfolds to, more than any memory holds.
"""

import io
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import can
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from generated import seeds
from generated.dialects import BYTES, Dialect, verbs_of
from scipy.io import savemat

from hil_bench import RecordingWish, VirtualBench
from hil_bench.abilities.campaign.store import program_identity
from hil_bench.abilities.recording import mdf_blocks as mdf
from hil_bench.cli import main

_GIB = 1 << 30
_MEASURED = "identify {} --columns columns.toml --time-limit 1 -o out"
_EDS = "decode frames.log --eds 1={}"
_TRC = """;$FILEVERSION=1.1
;$STARTTIME=43008.920986006946
;
    1)       1.0  Rx     0181  2  01 02
    2)       2.0  Rx     0701  1  05
    3)       3.0  Tx     0601  8  40 18 10 01 00 00 00 00
"""


def binary_dialects(folder: Path) -> tuple[Dialect, ...]:
    """Write sound files to a folder, and return the sorts of files that are no text."""
    paths = [folder / f"sound{suffix}" for suffix in (".mf4", ".blf", ".asc")]
    start = can.Message(arbitration_id=0, data=[1, 0], is_extended_id=False)
    with VirtualBench(record=RecordingWish(tuple(paths))) as bench:
        bench.bus.send(start)
        bench.run(0.1)
    mf4, blf, asc = (path.read_bytes() for path in paths)
    logs = verbs_of(
        "decode {}",
        "decode {} one_axis.toml --raw",
        "explain {} one_axis.toml",
        "shadow --log {} one_axis.toml",
        "plot {} -o out.png",
    )
    signals = verbs_of(
        "judge requirements.toml {}", "replay {} --virtual", "identify {} --time-limit 1 -o out"
    )
    stored = verbs_of(
        "campaign seed.scenario.toml --runs 1 --jobs 0 --merge -o generated",
        "campaign seed.scenario.toml --runs 1 --jobs 0 --merge -o kept --compare generated",
    )
    folder.joinpath("generated").mkdir()
    return (
        _binary("MF4", ".mf4", (*logs, *signals), mf4, *_mf4_bombs(mf4)),
        _binary("BLF", ".blf", logs, blf, _blf_bomb(blf)),
        _binary("ASC bytes", ".asc", logs, asc),
        _binary("TRC bytes", ".trc", logs, _TRC.encode()),
        _binary("MAT", ".mat", verbs_of(_MEASURED), *_mat_files()),
        *_texts(folder, logs),
        _binary("Parquet", "/one.parquet", stored, _kept_results(folder), _parquet_bomb()),
    )


def _binary(name: str, suffix: str, verbs: tuple[tuple[str, ...], ...], *seeds: bytes) -> Dialect:
    return Dialect(name, suffix, verbs, tuple(("examples", each) for each in seeds), BYTES)


def _texts(folder: Path, logs: tuple[tuple[str, ...], ...]) -> Iterator[Dialect]:
    """Yield texts, which are edited by bytes here."""
    (eds, *_), (dbc, *_) = seeds.EDS, seeds.examples("examples", "*.dbc")
    bench = (folder / "two_axes.toml").read_bytes()
    yield _binary("candump bytes", ".log", logs, seeds.LINES.encode())
    yield _binary(
        "EDS bytes", ".eds", verbs_of("check-eds {}", _EDS, "check with_eds.toml"), eds[1].encode()
    )
    yield _binary("DBC bytes", ".dbc", verbs_of("decode frames.log --dbc {}"), dbc[1].encode())
    yield _binary("TOML bytes", ".toml", verbs_of("check {}", "devices {}"), bench)
    tables = verbs_of("judge requirements.toml {}", "plot {} -o out.png", _MEASURED)
    yield _binary(
        "CSV bytes", ".csv", tables, seeds.recording().encode(), seeds.measured().encode()
    )


def _mf4_bombs(sound: bytes) -> Iterator[bytes]:
    """Yield an MF4 with a block of data of 2 GiB, and one that lists a block a million times."""
    head = mdf.HEADER.size
    at = sound.index(b"##DZ")
    kind, packing, spare, size, _, _ = mdf.DZ_DATA.unpack_from(sound, at + head)
    packed = _zeros(2 * _GIB)
    claim = mdf.DZ_DATA.pack(kind, packing, spare, size, 2 * _GIB // size * size, len(packed))
    yield _linked(sound, at, mdf.pack_block(b"##DZ", (), claim + packed))
    count = 1 << 20
    yield _linked(
        sound, sound.index(b"##DL"), mdf.pack_block(b"##DL", (0, *[at] * count), bytes(8))
    )


def _linked(sound: bytes, place: int, block: bytes) -> bytes:
    """Return an MF4 with a block at its end, in the place of the one at an address."""
    link, end = struct.pack("<Q", place), struct.pack("<Q", len(sound))
    return sound.replace(link, end, 1) + block


def _blf_bomb(sound: bytes) -> bytes:
    """Return a BLF with a container of 2 GiB of zeros."""
    packed = _zeros(2 * _GIB)
    head = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 32 + len(packed), 10)
    return sound[:144] + head + struct.pack("<H6xL4x", 2, 0) + packed


def _zeros(count: int, head: bytes = b"") -> bytes:
    """Return zeros behind a head, packed by zlib."""
    packing, part = zlib.compressobj(1), bytes(1 << 20)
    packed = packing.compress(head) + b"".join(packing.compress(part) for _ in range(count >> 20))
    return packed + packing.flush()


def _mat_files() -> Iterator[bytes]:
    """Yield MAT files as they are and packed, one with nested cells, and one of 3 GiB."""
    times = np.arange(0.0, 2.5, 0.01)
    columns = {name: np.sin(times) for name in ("x", "u", "pa", "pb")} | {"t": times}
    for is_packed in (False, True):
        file = io.BytesIO()
        savemat(file, columns, do_compression=is_packed)
        yield file.getvalue()
    nested: object = 1.0
    for _ in range(200):
        nested = np.array([nested], dtype=object)
    file = io.BytesIO()
    savemat(file, {"deep": nested, **columns})
    yield file.getvalue()
    values = struct.pack("<LL", 9, 3 * _GIB)
    head = struct.pack("<LLLLLLLLLL", 6, 8, 6, 0, 5, 8, 3 * _GIB // 8, 1, 1 << 16 | 1, ord("t"))
    matrix = struct.pack("<LL", 14, 3 * _GIB + len(head) + len(values)) + head + values
    packed = _zeros(3 * _GIB, matrix)
    yield file.getvalue()[:128] + struct.pack("<LL", 15, len(packed)) + packed


def _kept_results(folder: Path) -> bytes:
    """Return the results of a campaign of one run, which are also beside."""
    scenario = folder / "seed.scenario.toml"
    kept = folder / "kept"
    main(["campaign", str(scenario), "--runs", "1", "--jobs", "0", "-o", str(kept), "-q"])
    return next(kept.glob("*.parquet")).read_bytes()


def _parquet_bomb() -> bytes:
    """Return a Parquet file of a few KiB with 100,000,000 rows."""
    keys = pa.DictionaryArray.from_arrays(np.zeros(100_000_000, dtype=np.int8), pa.array(["a"]))
    table = pa.table({"key": keys}).replace_schema_metadata(
        {b"hil-bench": program_identity().encode(), b"set": b""}
    )
    file = io.BytesIO()
    pq.write_table(table, file, compression="zstd")
    return file.getvalue()
