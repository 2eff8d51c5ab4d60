"""Signals: raw = (value - offset) / resolution, and the special values of SAE J1939-71.

8 bits: 0 to 250 valid, 0xFE error, 0xFF not available; 16 bits: 0 to 0xFAFF, 0xFExx, 0xFFxx;
2 bits: 0, 1, then 2 and 3. A joystick's 10 bits have 1022 and 1023 (Danfoss JS6000, 520L0760).
"""

import math

import pytest

from hil_bench.abilities.j1939.protocol.signal_table import Indication, SentGroup, SentSignal, Show
from hil_bench.abilities.j1939.protocol.signals import Signal


@pytest.mark.parametrize(
    ("length", "highest", "error", "not_available"),
    [
        (2, 1, 2, 3),
        (4, 13, 14, 15),
        (8, 250, 254, 255),
        (10, 1003, 1022, 1023),
        (16, 0xFAFF, 0xFE00, 0xFFFF),
        (32, 0xFAFFFFFF, 0xFE000000, 0xFFFFFFFF),
    ],
)
def test_special_values(length, highest, error, not_available):
    signal = Signal(0, length)

    assert (signal.highest, signal.error, signal.not_available) == (highest, error, not_available)
    assert signal.raw(1e12) == highest
    assert signal.raw(-1e12) == 0
    assert signal.raw(math.nan) == error
    for raw in (error, not_available):
        assert math.isnan(signal.value(raw.to_bytes(4, "little")))


def test_a_value_has_resolution_and_offset():
    flow = Signal(8, 8, 1.0, -125.0)

    assert flow.raw(-25.0) == 100
    assert flow.value(b"\x00\xe1") == 100.0  # 225 - 125
    assert math.isnan(flow.value(b"\x00"))  # too short


def group(*signals):
    return SentGroup(0xFDD6, 0, 3, list(signals)).make().hex(" ")


@pytest.mark.parametrize(
    ("value", "data"),
    # Byte 1: neutral 2-1, left 4-3, right 6-5, position 8-7; byte 2: position, 0.1 % a bit.
    [
        (0.0, "01 00"),  # neutral
        (-50.0, "04 7d"),  # left, 500 = 0x1F4: 00 and 0x7D
        (100.0, "10 fa"),  # right, 1000 = 0x3E8: 00 and 0xFA
        (math.nan, "aa ff"),  # 10 in all of them, 1022
    ],
)
def test_a_joystick_shows_size_and_side(value, data):
    shown = ((6, 10, Show.SIZE), (0, 2, Show.NEUTRAL), (2, 2, Show.NEGATIVE), (4, 2, Show.POSITIVE))
    signals = [
        SentSignal(Signal(start, length, 0.1 if length == 10 else 1.0), show, 1.0, value=value)
        for start, length, show in shown
    ]

    assert group(*signals) == f"{data} ff ff ff ff ff ff"


def test_an_indication_stands_in_place_of_the_value():
    signal = SentSignal(Signal(0, 8), value=5.0)

    signal.indications.append(Indication.ERROR)
    assert group(signal)[:2] == "fe"
    signal.indications.append(Indication.NOT_AVAILABLE)
    assert group(signal)[:2] == "ff"
    assert not signal.is_error


def test_a_group_may_be_longer_than_a_frame():
    assert group(SentSignal(Signal(64, 16), value=258.0)) == "ff " * 8 + "02 01"
