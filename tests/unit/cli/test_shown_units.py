"""One choice of units for people: words, sets, and texts in them."""

import math

import pytest

from hil_bench.abilities.common.shown_units import (
    QUANTITIES,
    USUAL,
    VARIABLE,
    chosen,
    parse_choice,
    shown_unit,
    units_content,
)
from hil_bench.errors import ConfigError


# By definition: 1 in = 25.4 mm, 1 lbf = 4.4482216152605 N, 1 US gal = 3.785411784 l.
def test_a_value_is_shown_in_the_chosen_unit():
    rows = [
        ("", "Pa", 123.4e5, "123.4 bar"),
        ("MPa", "Pa", 123.4e5, "12.340 MPa"),
        ("psi", "Pa", 4.4482216152605 / 0.0254**2 * 3000, "3000 psi"),
        ("in", "m", 0.0254, "1.0000 in"),
        ("", "m", 0.0254, "25.40 mm"),
        ("", "m³/s", 1e-3 / 60, "1.00 l/min"),
        ("gpm", "m³/s", 3.785411784e-3 / 60, "1.000 gpm"),
        ("deg", "rad", math.pi, "180.00 deg"),
        ("", "rad/s", math.tau, "60.0 rpm"),
        ("", "N", 5000.0, "5.000 kN"),
        ("", "-", 0.125, "12.5 %"),
        ("us", "m", -1e-9, "0.0000 in"),
        ("us", "V", 1.5, "1.500 V"),
    ]
    for words, symbol, value, text in rows:
        shown = shown_unit(symbol, parse_choice(words))
        assert f"{shown.text(value)} {shown.symbol}" == text


@pytest.mark.parametrize("value", [None, math.nan, math.inf, -math.inf])
def test_a_value_that_is_not_there_is_no_number(value):
    assert shown_unit("Pa").text(value) == "-"


def test_words_add_to_what_is_usual_and_to_a_set():
    assert parse_choice("psi") == {**USUAL, "pressure": "psi"}
    assert parse_choice("mm,us")["length"] == "mm"
    assert parse_choice("us")["length"] == "in"
    assert parse_choice("metric") == USUAL


@pytest.mark.parametrize(
    ("words", "wrong"),
    [("fathom", "units 'fathom': give some of metric, us, bar"), ("psi,bar", "both of pressure")],
)
def test_a_wrong_word_is_one_line(words, wrong):
    with pytest.raises(ConfigError) as caught:
        parse_choice(words)
    assert wrong in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_environment_chooses_and_a_wrong_one_is_named(monkeypatch):
    monkeypatch.setenv(VARIABLE, "psi,in")
    assert chosen()["pressure"] == "psi"
    monkeypatch.setenv(VARIABLE, "ell")
    with pytest.raises(ConfigError, match=f"{VARIABLE}: units 'ell'"):
        chosen()


def test_a_wrong_option_is_a_usage_error(cli):
    assert "units 'ell': give some of metric" in cli("watch --units ell", 2).err


def test_every_way_of_a_quantity_has_the_same_si_units():
    for words in QUANTITIES.values():
        assert len({frozenset(each) for each in words.values()}) == 1


def test_a_page_gets_the_table_and_the_choice(monkeypatch):
    monkeypatch.setenv(VARIABLE, "MPa")
    content = units_content()
    assert content["chosen"]["pressure"] == "MPa"
    assert content["units"]["Pa"]["shown"]["MPa"]["factor"] == 1e6
    assert content["sets"]["us"]["flow"] == "gpm"
