import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.encoders import move

from device_profiles import ENCODER_406
from hil_bench.devices.bound_objects import nearest
from hil_bench.devices.encoder_406 import EncoderDevice


@given(value=st.floats(allow_nan=False, allow_infinity=False))
def test_it_is_what_round_says(value):
    assert nearest(value) == round(value)


@given(whole=st.integers(-(2**51) - 2, 2**51 + 2), part=st.sampled_from((-0.5, 0.25, 0.5)))
def test_of_two_that_are_as_near_it_is_the_even_one(whole, part):
    assert nearest(whole + part) == round(whole + part)


@pytest.mark.parametrize("whole", [0, 1, 2, 2**51 - 1, 2**51, 2**53])
def test_the_next_value_below_a_half_falls_to_the_smaller_one(whole):
    value = math.nextafter(whole + 0.5, 0.0)

    assert nearest(value) == round(value)
    assert nearest(-value) == -round(value)


# An encoder whose EDS has the ends of its range unsigned: what is below 0 shows as 0.


def test_an_end_below_0_is_0_where_the_object_is_unsigned(make_rig, make_file):
    text = ENCODER_406.read_text(encoding="ascii")
    for section in ("[650Asub2]", "[650Asub3]"):
        before, after = text.split(section)
        text = before + section + after.replace("DataType=0x0004", "DataType=0x0007", 1)
    path = make_file("unsigned.eds", text)
    rig = make_rig(path)
    rig.device = EncoderDevice(rig.node, (-0.1, 0.3))
    move(rig, 0.0)
    assert rig.write(0x6005, 1, 1000, 4) is None  # 1 um
    # -100,000 steps is nothing that UNSIGNED32 holds; 0.3 m are 300,000, and the range 400,000.
    assert [rig.value(0x650A, 2), rig.value(0x650A, 3)] == [0, 300_000]
    assert rig.value(0x6002) == 400_000
