"""A chip and its program, as they are to be simulated."""

import json
from pathlib import Path
from typing import NamedTuple


class Job(NamedTuple):
    """A chip and its program.

    Attributes:
        path: of the ELF file.
        chip: its name.
        instructions_per_ms: that it does.
        crystal_hz: frequency of its crystal [Hz].
        can: numbers of the CAN controllers, from 1, in the order of the buses.
        bit_ns: duration of a bit on each bus [ns].
        jitter_ns: the longest that a frame to the chip comes late [ns].
        seed: from which its delays are drawn.
    """

    path: Path
    chip: str
    instructions_per_ms: int
    crystal_hz: int
    can: tuple[int, ...]
    bit_ns: tuple[int, ...]
    jitter_ns: int = 0
    seed: str = ""


def write_job(job: Job) -> str:
    """Return a job as text."""
    return json.dumps((str(job.path), *job[1:]))


def read_job(text: str) -> Job:
    """Return the job of a text."""
    path, chip, instructions_per_ms, crystal_hz, can, bit_ns, *drawn = json.loads(text)
    return Job(Path(path), chip, instructions_per_ms, crystal_hz, tuple(can), tuple(bit_ns), *drawn)
