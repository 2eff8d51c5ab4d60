"""The sound logs: read from `logs/`, made by the bench in virtual time, or timed like copper.

`README.md` says how each was made. Half of them are kept apart by a hash of their name: nobody
looks at these while `explain` is written, and `benchmarks/eyes.py` judges by them.
"""

import hashlib
import lzma
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import device_profiles
from corpus.copper import timed_like_copper
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import LoggedFrame

HERE = Path(__file__).parent
EDS = Path(device_profiles.__file__).parent
VIRTUAL_BITRATE = 1_000_000
_NS = 1_000_000_000


class SoundLog(NamedTuple):
    """A log in which nothing is wrong.

    Attributes:
        name: of the log; the stack comes first.
        frames: in the order of time.
        eds: EDS file of `device_profiles` of each node that has one at hand, by node-ID.
        bitrate: of the bus [bit/s].
        series: it belongs to; empty for the first one.
    """

    name: str
    frames: tuple[LoggedFrame, ...]
    eds: dict[int, str]
    bitrate: int
    series: str = ""

    def known(self) -> list[KnownNode]:
        """Return the nodes of which the reader has an EDS, new ones each time."""
        return [KnownNode(node, "", load_eds(EDS / name, node)) for node, name in self.eds.items()]


def is_kept_apart(name: str) -> bool:
    """Return True for the half of the logs that is judged at the end alone."""
    return hashlib.sha256(name.encode()).digest()[0] % 2 == 1


@cache
def manifest() -> dict[str, dict[str, object]]:
    """Return the entries of `corpus.toml` by the name of the log."""
    return tomllib.loads((HERE / "corpus.toml").read_text(encoding="utf-8"))


def sound_logs(*, kept_apart: bool | None = None, series: str | None = None) -> Iterator[SoundLog]:
    """Yield the sound logs: all, those of one half, and each that copper has timed.

    Args:
        kept_apart: which half; None for both.
        series: which series; None for all.
    """
    for name, entry in sorted(manifest().items()):
        if series is not None and str(entry.get("series", "")) != series:
            continue
        if kept_apart is None or is_kept_apart(name) is kept_apart:
            yield sound_log(name)


@cache
def sound_log(name: str) -> SoundLog:
    """Return one log of the manifest."""
    entry = manifest()[name]
    bitrate = int(str(entry.get("bitrate", VIRTUAL_BITRATE)))
    eds = {int(node): str(file) for node, file in dict(entry.get("eds", {})).items()}  # type: ignore[call-overload]  # of TOML
    frames = read(HERE / "logs" / f"{entry.get('log', name)}.log.xz")
    if entry.get("copper"):
        frames = timed_like_copper(frames, bitrate)
    return SoundLog(name, tuple(frames), eds, bitrate, str(entry.get("series", "")))


def read(path: Path) -> list[LoggedFrame]:
    """Return the frames of a compressed log of `candump -L`, its first at 0 ns."""
    with lzma.open(path, "rt", encoding="ascii") as file:
        return [frame_of(line) for line in file]


def frame_of(line: str) -> LoggedFrame:
    """Return the frame of one line, as in ``(0.001000) c 182#0102``."""
    time, _, text = line.split()
    seconds, _, micro = time[1:-1].partition(".")
    name, _, data = text.partition("#")
    is_remote = data.startswith("R")
    frame = Frame(
        int(name, 16),
        b"" if is_remote else bytes.fromhex(data),
        is_remote,
        is_extended=len(name) > 3,
    )
    return LoggedFrame(frame, int(seconds) * _NS + int(micro) * 1000, None)
