"""Standard streams that are closed, full, or of a narrow encoding."""

import gc
import io
import os
import shlex
import subprocess
import sys

import pytest

from hil_bench import cli
from hil_bench.cli.process import collection_put_off, prepare_streams

CALL = f"{shlex.quote(sys.executable)} -m hil_bench"


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


@pytest.mark.parametrize(
    ("name", "number", "mode"), [("stdin", 0, "r"), ("stdout", 1, "w"), ("stderr", 2, "w")]
)
def test_a_stream_that_python_has_not_is_opened_by_its_number(name, number, mode, monkeypatch):
    monkeypatch.setattr(sys, name, None)
    prepare_streams()
    stream = getattr(sys, name)
    assert (stream.fileno(), stream.mode) == (number, mode)
    stream.close()  # which closes no descriptor of this process
    os.fstat(number)


def test_nothing_is_collected_within_the_block_and_all_is_as_before_after_it():
    def fail():
        with collection_put_off():
            assert not gc.isenabled()
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert gc.isenabled()


def test_who_has_switched_it_off_finds_it_off():
    gc.disable()
    try:
        with collection_put_off():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()


def test_a_verb_runs_with_it(monkeypatch):
    seen = []
    monkeypatch.setattr(
        "hil_bench.cli._set_up_logging", lambda *_, **__: seen.append(gc.isenabled())
    )
    cli.main(["devices"])
    assert seen == [True]


@pytest.mark.parametrize(("argv", "frozen"), [(None, True), (["devices"], False)])
def test_only_a_process_of_its_own_leaves_what_was_imported_out_of_later_collections(
    monkeypatch, argv, frozen
):
    monkeypatch.setattr("sys.argv", ["hil-bench", "devices"])
    before = gc.get_freeze_count()
    try:
        cli.main(argv)
        assert (gc.get_freeze_count() > before) == frozen
    finally:
        gc.unfreeze()
