"""Presets of the linear encoder, 0x6003 and 0x6010: the present position becomes a value.

Steps: 0x6005.01 = 1000 is 1 um, so that 1 m is 1,000,000 steps.
"""

import pytest
from support.encoders import fit_encoder, move, position

from device_profiles import ENCODER_406


@pytest.fixture
def rig(make_rig):
    return fit_encoder(make_rig(ENCODER_406))


@pytest.mark.parametrize(("index", "subindex"), [(0x6003, 0), (0x6010, 1)])
@pytest.mark.parametrize("preset", [0, 5000, -5000, 2147483647])
def test_a_preset_makes_the_present_position_that_value(rig, index, subindex, preset):
    move(rig, 0.25)  # 250000 steps
    assert rig.write(index, subindex, preset, 4, signed=True) is None
    assert position(rig) == preset  # at once, not only with the next tick
    assert (rig.value(0x6003), rig.value(0x6010, 1)) == (preset, preset)
    assert (rig.value(0x6509), rig.value(0x650C, 1)) == (preset - 250000, preset - 250000)
    move(rig, 0.25)
    assert position(rig) == preset
    move(rig, 0.2)
    assert position(rig) == preset - 50000


def test_presets_do_not_add_up(rig):
    move(rig, 0.1)
    assert rig.write(0x6003, 0, 7, 4) is None
    move(rig, 0.2)
    assert rig.write(0x6003, 0, 9, 4) is None
    move(rig, 0.2)
    assert (position(rig), rig.value(0x6509)) == (9, 9 - 200000)


def test_a_preset_rounds_like_the_position(rig):
    move(rig, 1.5e-6)  # 1.5 steps show as 2
    assert rig.write(0x6003, 0, 101, 4) is None
    move(rig, 1.5e-6)
    assert position(rig) == 101


def test_a_preset_counts_in_the_steps_that_are_in_force(rig):
    move(rig, 0.1)
    for index, subindex, value in ((0x6005, 1, 10000), (0x6003, 0, 50)):  # in one tick
        rig.object_dictionary.download(index, subindex, value.to_bytes(4, "little"))
    move(rig, 0.1)
    assert position(rig) == 50
    assert rig.value(0x6509) == 50 - 10000  # 0.1 m are 10000 steps of 10 um


def test_a_reversed_encoder_takes_a_preset(rig):
    assert rig.write(0x6000, 0, 0x0008, 2) is None
    move(rig, 0.1)
    assert rig.write(0x6003, 0, 1000, 4) is None
    move(rig, 0.101)
    assert position(rig) == 0  # 1 mm against the direction


def test_a_preset_beyond_the_offset_is_refused(rig):
    move(rig, -2147.0)  # -2,147,000,000 steps
    assert rig.write(0x6003, 0, 1000000, 4) == 0x06090030
    assert (position(rig), rig.value(0x6003), rig.value(0x6509)) == (-2147000000, 0, 0)


def test_the_counter_ends_after_the_offset(rig):
    move(rig, 0.0)
    assert rig.write(0x6003, 0, 2147483000, 4) is None
    move(rig, 0.000648)  # one step too far
    assert (position(rig), rig.value(0x6503)) == (2147483647, 0x0001)
    move(rig, 0.000647)
    assert (position(rig), rig.value(0x6503)) == (2147483647, 0)


def test_a_node_reset_takes_the_preset_back(rig):
    move(rig, 0.1)
    assert rig.write(0x6003, 0, 7, 4) is None
    rig.nmt(rig.RESET_NODE)
    move(rig, 0.1)
    assert (position(rig), rig.value(0x6509)) == (100000, 0)


def test_an_unsigned_preset_beyond_the_counter_is_refused(make_rig, make_file):
    # Profile files have UNSIGNED32 for 0x6003, and makers of linear encoders INTEGER32 for 0x6004.
    text = ENCODER_406.read_text(encoding="ascii")
    start = text.index("[6003]")
    eds = make_file("unsigned.eds", text[:start] + text[start:].replace("0x0004", "0x0007", 1))
    rig = fit_encoder(make_rig(eds))
    move(rig, 1000.0)  # 1,000,000,000 steps, so that the offset would fit
    assert rig.write(0x6003, 0, 2147483648, 4) == 0x06090030
    assert rig.write(0x6003, 0, 2147483647, 4) is None
    assert position(rig) == 2147483647
