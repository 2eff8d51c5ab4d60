"""Varied runs leave the same bytes as they did when `digests.json` was written.

Written by this file run as a program, ``python tests/golden/test_golden.py``. A change that is
meant to move no byte must leave `digests.json` as it is; one that moves some says in its message
which and why.
"""

import hashlib
import json
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # as pytest does by `pythonpath`

from golden.runs import RUNS, at_root, frame_lines

import hil_bench
from hil_bench.abilities.recording.frames import read_frames
from hil_bench.abilities.recording.reading import read_recording

DIGESTS = Path(__file__).with_name("digests.json")
PACKED = {".blf", ".mf4"}
"""Formats whose bytes depend on the compressor: what they hold counts."""


def digest(path: Path) -> str:
    """Return the SHA-256 of what a file holds, whichever version of the bench wrote it."""
    if path.suffix in PACKED:
        content = frame_lines(read_frames(path)).encode()
        if path.suffix == ".mf4":
            content += read_recording(path).tobytes()
    else:
        content = path.read_bytes().replace(hil_bench.__version__.encode(), b"VERSION")
    return hashlib.sha256(content).hexdigest()


def digests(name: str, directory: Path) -> dict[str, str]:
    """Return the digests of the files that a run leaves; pictures depend on fonts."""
    with at_root():
        RUNS[name](directory)
    kept = [path for path in sorted(directory.iterdir()) if path.suffix not in {".png", ".toml"}]
    return {path.name: digest(path) for path in kept}


@pytest.mark.golden
@pytest.mark.parametrize("name", RUNS)
def test_a_run_leaves_the_bytes_that_it_left(name: str, tmp_path: Path) -> None:
    if name == "lockstep_firmware" and not (shutil.which("make") and shutil.which("cc")):
        pytest.skip("no C compiler; apt-get install make gcc libc6-dev")
    assert digests(name, tmp_path) == json.loads(DIGESTS.read_text())[name]


def write() -> None:
    """Write the digests of this state of the sources."""
    stored = {}
    for name in RUNS:
        with TemporaryDirectory() as directory:
            stored[name] = digests(name, Path(directory))
    DIGESTS.write_text(json.dumps(stored, indent=2) + "\n")


if __name__ == "__main__":
    write()
