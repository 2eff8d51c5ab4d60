"""Temporary folders of processes that are killed, and of those that live."""

import pathlib
import signal
import subprocess
import sys
import tempfile

import pytest

from hil_bench import scratch
from hil_bench.abilities.common.files import scratch_folder
from hil_bench.scratch import ScratchFolder

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no flock")

HOLDS = """
from hil_bench.scratch import ScratchFolder
folder = ScratchFolder()
(folder.path / "file").write_text("x")
print(folder.path, flush=True)
input()
"""


@pytest.fixture(autouse=True)
def temporary(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    scratch._sweep.cache_clear()
    yield tmp_path
    scratch._sweep.cache_clear()


@pytest.fixture
def holder():
    """A process that holds a folder, and its folder's name."""
    process = subprocess.Popen(  # noqa: S603 - the program above
        [sys.executable, "-c", HOLDS], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    yield process, process.stdout.readline().strip()
    process.kill()
    process.communicate()


def test_a_folder_of_a_killed_process_goes_with_the_next_start(temporary, holder):
    process, left = holder
    with scratch_folder() as mine:
        assert sorted(map(str, temporary.iterdir())) == sorted([left, str(mine)])
        process.send_signal(signal.SIGKILL)
        process.wait()
        scratch._sweep.cache_clear()  # as another process would begin
        with scratch_folder() as next_one:
            assert set(temporary.iterdir()) == {mine, next_one}
    assert list(temporary.iterdir()) == []


def test_what_is_no_folder_of_ours_stays(temporary):
    for name in ("hil-bench-commissioning", "other-1"):
        (temporary / name).mkdir()
    (temporary / "other-1" / ".held").touch()
    ScratchFolder().remove()
    assert {path.name for path in temporary.iterdir()} == {"hil-bench-commissioning", "other-1"}


def test_a_sweep_between_folder_and_lock_costs_another_folder(temporary, monkeypatch):
    """Another process takes the folder away before its lock is held."""
    real, made = tempfile.mkdtemp, []

    def mkdtemp(prefix):
        made.append(real(prefix=prefix))
        if len(made) == 1:
            pathlib.Path(made[0]).rmdir()
        return made[-1]

    monkeypatch.setattr(tempfile, "mkdtemp", mkdtemp)
    folder = ScratchFolder()
    assert [str(path) for path in temporary.iterdir()] == [str(folder.path)] == made[1:]
    folder.remove()
