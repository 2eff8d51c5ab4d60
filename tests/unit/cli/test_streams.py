"""Standard streams that are closed, full, or of a narrow encoding."""

import io
import subprocess
import sys

import pytest

from hil_bench.cli.exit_codes import prepare_streams

CALL = f"{sys.executable} -m hil_bench"


def sh(command):
    return subprocess.run(  # noqa: S603 - our own command
        ["/bin/sh", "-c", command], capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_a_closed_stream_is_no_error(closed):
    done = sh(f"{CALL} devices {closed}")
    assert (done.returncode, done.stderr) == (0, "")


def test_a_full_disk_is_one_line_and_exit_code_5():
    done = sh(f"{CALL} devices >/dev/full")
    assert done.returncode == 5
    assert done.stderr == "hil-bench: error: standard output: No space left on device\n"


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_character_that_the_encoding_lacks_is_escaped(encoding, monkeypatch):
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding))
    prepare_streams()
    sys.stdout.write("√\n")
    sys.stdout.flush()
    assert written.getvalue() == b"\\u221a\n"
