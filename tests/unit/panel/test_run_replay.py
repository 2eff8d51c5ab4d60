"""A run that is played again for a page: nothing but a campaign's own words is ever started."""

import asyncio
import json

import pytest

from hil_bench.abilities.panel import record
from hil_bench.errors import ConfigError

AGAIN = ["campaign", "/somewhere/campaign.toml", "--runs=8", "--set=target_mm=100 mm"]
KEY = "0f8567fd"


def replayed(again, key=KEY):
    return asyncio.run(record.replay_run(again, key))


@pytest.fixture(params=[0, 1, 6], ids=["passed", "failed", "undecided"])
def played(monkeypatch, request):
    """The words that were started; the run comes to an end, and its picture is a word."""
    found = []

    async def play(words):
        found.append(words)
        (place,) = (word.partition("=")[2] for word in words if word.startswith("--picture="))
        with open(place, "wb") as file:  # noqa: PTH123 - three bytes, of a test
            file.write(b"svg")
        return request.param, json.dumps({"run": {"key": KEY}}).encode(), b""

    monkeypatch.setattr(record, "_play", play)
    return found


def test_a_run_comes_with_its_picture(played):
    assert replayed(AGAIN) == {
        "run": {"key": KEY},
        "picture": "data:image/svg+xml;base64,c3Zn",  # "svg" in base64
    }
    (words,) = played
    assert words[: len(AGAIN)] == AGAIN
    assert f"--run={KEY}" in words


@pytest.mark.parametrize(
    "again",
    [
        None,
        [],
        "campaign",
        ["campaign"],
        ["test", "x.toml"],
        ["campaign", "--merge"],
        ["campaign", "x.toml", "--output=/tmp"],
        ["campaign", "x.toml", 5],
    ],
)
def test_other_words_are_refused(played, again):
    with pytest.raises(ConfigError, match="no campaign"):
        replayed(again)
    assert played == []


@pytest.mark.parametrize("key", ["", "--merge", "xyz", "0f85 67fd", "f" * 65])
def test_what_is_no_key_is_refused(played, key):
    with pytest.raises(ConfigError, match="hexadecimal"):
        replayed(AGAIN, key)
    assert played == []


def test_the_errors_of_a_run_that_cannot_be_played_are_passed_on(monkeypatch):
    async def play(_words):
        return 2, b"", b"hil-bench: campaign.toml: is not there\n"

    monkeypatch.setattr(record, "_play", play)
    with pytest.raises(ConfigError, match=r"campaign\.toml: is not there"):
        replayed(AGAIN)
