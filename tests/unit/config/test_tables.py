"""The reader of all dialects of TOML: its problems, and what it leaves out."""

import tomllib

import pytest

from hil_bench.config.document import Tables
from hil_bench.config.settings import Given, Key, Origin, Problems, read_table
from hil_bench.config.values import integer, texts
from hil_bench.errors import ConfigError

KEYS = (Key("speed", integer(1, 9), 5), Key("steps", integer(0), example="3"))


@pytest.fixture
def reader():
    """Return a function that makes a reader of a text."""

    def read(text):
        return Tables(tomllib.loads(text), Problems("f.toml"))

    return read


def problems_of(tables):
    with pytest.raises(ConfigError) as caught:
        tables.problems.raise_any()
    return str(caught.value).splitlines()


def test_the_head_is_read_beside_tables(reader):
    tables = reader("speed = 7\nsteps = 0\nstpes = 1\n[motor]\nx = 1\n")

    found = tables.head(KEYS, ("motor",))

    assert {name: each.value for name, each in found.items()} == {"speed": 7, "steps": 0}
    assert problems_of(tables) == ["f.toml:stpes: unknown; the nearest known is steps"]


def test_named_tables_are_read_by_their_names(reader):
    tables = reader('[m.a]\nsteps = 1\n[m.b]\nspeed = 10\n[m]\nc = 3\n"d e" = {}\n')

    found = tables.named("m", KEYS)

    assert found["a"]["steps"].value == 1
    assert found["a"]["speed"].origin is Origin.DEFAULT
    assert "c" not in found
    assert problems_of(tables) == [
        "f.toml:m.c: 3 is not a table; write it as [m.NAME]",
        'f.toml:m: "d e" cannot be a name; give at most 32 letters, digits, _ or -',
        "f.toml:m.b.speed: 10 is out of range; give an integer from 1 to 9",
        "f.toml:m.b.steps: missing; give for example steps = 3",
    ]


def test_a_list_of_tables_is_numbered(reader):
    assert reader("[[s]]\na = 1\n[[s]]\nb = 2\n").listed("s") == [
        ("s[1]", {"a": 1}),
        ("s[2]", {"b": 2}),
    ]
    tables = reader("s = [1]\n")
    assert tables.listed("s") == []
    assert problems_of(tables) == ["f.toml:s: an array is no list; write it as [[s]]"]


def test_entries_are_names_with_values(reader):
    tables = reader('[firmware]\nours = ["run"]\ntheirs = 3\n')

    assert tables.entries("firmware", texts) == {"ours": ("run",)}
    (problem,) = problems_of(tables)
    assert problem.startswith("f.toml:firmware.theirs: 3 is not a list of texts")


def test_a_value_that_has_a_place_keeps_it():
    problems = Problems("f.toml")
    values = {"speed": Given(10, Origin.COMMAND_LINE, "--speed"), "steps": 1}

    found = read_table("m", values, KEYS, problems)

    assert found["steps"].origin is Origin.FILE
    with pytest.raises(ConfigError, match=r"^--speed: 10 is out of range"):
        problems.raise_any()
