"""Messages that a terminal may have, and files that are written whole or not at all."""

import contextlib
import errno
import os

import pytest

from hil_bench.abilities.common.files import whole_file
from hil_bench.errors import BusError, ConfigError, about_file
from hil_drivers.errors import BusLostError


@pytest.mark.parametrize("error", [ConfigError, BusError, BusLostError])
def test_a_message_may_quote_anything_and_is_still_printable(error):
    said = str(error("there is no file a\tb\x1b[2J\x9b.eds\nsecond line, 0.5 \u00b5m"))
    assert said == r"there is no file a\tb\x1b[2J\x9b.eds" + "\nsecond line, 0.5 \u00b5m"


def fill_the_disk(path):
    path.write_text("half")
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("before", [None, "# Written by hil-bench: before"])
def test_a_file_that_cannot_be_written_to_its_end_is_left_as_it_was(tmp_path, before):
    path = tmp_path / "bench.toml"
    if before is not None:
        path.write_text(before)
    wrong = r"bench\.toml: cannot be written: No space left on device$"
    with pytest.raises(ConfigError, match=wrong), about_file(path), whole_file(path) as file:
        fill_the_disk(file)
    assert [each.read_text() for each in tmp_path.iterdir()] == ([before] if before else [])


def test_an_interruption_leaves_nothing_behind(tmp_path):
    with contextlib.suppress(KeyboardInterrupt), whole_file(tmp_path / "plot.png") as file:
        file.write_text("half")
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_a_whole_file_takes_the_place_of_the_old_one(tmp_path, make_file):
    path = make_file("report.txt", "before")
    with whole_file(path) as file:
        assert file.suffix == ".txt"  # which says the format of a picture
        file.write_text("after")
        assert path.read_text() == "before"
    assert [each.read_text() for each in tmp_path.iterdir()] == ["after"]


def test_a_link_stays_a_link(tmp_path):
    target, link = tmp_path / "target.txt", tmp_path / "link.txt"
    link.symlink_to(target)
    with whole_file(link) as file:
        file.write_text("x")
    assert link.is_symlink()
    assert target.read_text() == "x"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.csv", b"name,phone\n"),
        ("a.mf4", b"MDF     4.10    amd.mdf \0"),
        ("a.png", b"no picture"),
        ("a.html", b"<!doctype html><title>Of a user</title>"),
        ("a.dbc", b'VERSION ""\n'),
        ("a.json", b"words"),
        ("a.toml", b"# the press of hall 3\n"),
        ("a.md", b"# Notes\n"),
        ("a.py", b'"""Of a user."""\n'),
        ("a.cdcf", b"words"),
    ],
)
def test_a_file_of_somebody_else_is_not_replaced(make_file, name, content):
    path = make_file(name, content)
    wrong = "is there already, and not written by hil-bench"
    with pytest.raises(ConfigError, match=wrong), whole_file(path) as file:
        file.write_bytes(b"new")
    assert path.read_bytes() == content


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.csv", b"time,axis1.position\n"),
        ("a.mf4", b"MDF     4.10    hilbench"),
        ("a.png", b"\x89PNG"),
        ("a.html", b"<!doctype html><title>hil-bench</title>"),
        ("a.json", b""),
        ("a.toml", b"# Written by hil-bench, which replaces files that begin so.\n"),
        ("a.md", b"# CANopen conformance report\n"),
        ("a.md", b"# Axis 1\n\n**passed**\n\n## Steps\n"),
        ("a.py", b'"""SRS-1 fails: found by hil-bench falsify in a.scenario.toml."""\n'),
        ("a.cdcf", b"\2\0\0\0"),
        ("a.txt", b"words"),
    ],
)
def test_what_the_bench_wrote_is_replaced(make_file, name, content):
    path = make_file(name, content)
    with whole_file(path) as file:
        file.write_bytes(b"new")
    assert path.read_bytes() == b"new"
