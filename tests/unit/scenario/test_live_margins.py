"""Margins while a run goes on: what a look says, and what ranges requirements want of channels."""

from types import SimpleNamespace

import numpy as np
import pytest

from hil_bench.abilities.scenario.nodes import Vocabulary
from hil_bench.abilities.scenario.parse import parse_expectation
from hil_bench.abilities.scenario.resolve import Requirement
from hil_bench.abilities.scenario.verbs.scenario_view import LiveMargins, bands_of

CHANNELS = {"a.position": "m", "a.P_A": "Pa"}


def condition(text):
    return parse_expectation(text, Vocabulary(CHANNELS))


class Rows:
    """A witness of a run that goes on."""

    def __init__(self, **values):
        self._values = values
        self.ticks = 0

    def columns(self, start=0):
        return {
            name.replace("__", "."): np.array(values[start : self.ticks])
            for name, values in self._values.items()
        }


def live(text, rows, tick_ns=1_000_000):
    requirement = Requirement("R1", text, condition(text))
    prepared = SimpleNamespace(config=SimpleNamespace(tick_ns=tick_ns), requirements=(requirement,))
    return LiveMargins(prepared, rows)


def test_a_margin_is_the_worst_so_far_with_its_time():
    position = [0.05] * 100 + [0.069] * 100 + [0.05] * 100
    rows = Rows(a__position=position)
    look = live("always a.position < 70 mm", rows)
    rows.ticks = 64
    (first,) = look.look()
    assert first.text.startswith("20 mm")
    rows.ticks = 300
    (second,) = look.look()
    # 70 mm less 69 mm; first seen with the second block of 64 ticks of a millisecond.
    assert second.text == "1 mm, since 0.13 s"
    assert second.verdict == ""


def test_a_violation_is_failed_at_once():
    rows = Rows(a__position=[0.0701] * 64)
    look = live("always a.position < 70 mm", rows)
    rows.ticks = 64
    (found,) = look.look()
    assert found.verdict == "failed"
    assert found.margin < 0.0
    assert found.text.startswith("-0.1 mm")


def test_nothing_seen_is_no_margin():
    (found,) = live("always a.position < 70 mm", Rows(a__position=[])).look()
    assert (found.verdict, found.margin, found.text) == ("", None, "")


@pytest.mark.parametrize(
    ("text", "bands"),
    [
        ("always a.position < 70 mm", [("a.position", None, 0.07)]),
        ("always a.position >= 10 mm", [("a.position", 0.01, None)]),
        ("always 10 mm <= a.position", [("a.position", 0.01, None)]),
        ("always abs(a.position - 100 mm) < 0.5 mm", [("a.position", 0.0995, 0.1005)]),
        ("always a.P_A > 5 bar implies a.position < 70 mm", [("a.position", None, 0.07)]),
        ("always not a.position < 70 mm", []),
        ("always a.position < 70 mm or a.P_A < 5 bar", []),
    ],
)
def test_the_range_of_a_channel_is_that_of_what_must_hold(text, bands):
    found = [tuple(each)[:3] for each in bands_of(condition(text))]
    assert [name for name, *_ in found] == [name for name, *_ in bands]
    for (_, *have), (_, *want) in zip(found, bands, strict=True):
        assert have == [each if each is None else pytest.approx(each) for each in want]


@pytest.mark.parametrize(
    ("text", "when"),
    [
        ("always a.position < 70 mm", (0.0, None, True)),
        ("always from 1.8 s to 2.5 s a.position < 70 mm", (1.8, 2.5, True)),
        ("within 2 s a.position > 70 mm", (0.0, 2.0, False)),
        ("always a.P_A > 5 bar implies a.position < 70 mm", (0.0, None, False)),
    ],
)
def test_a_band_has_the_time_in_which_it_must_hold(text, when):
    (band,) = bands_of(condition(text))
    assert (band.begin, band.end, band.is_strict) == when
