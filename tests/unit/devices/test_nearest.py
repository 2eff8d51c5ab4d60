import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.devices.profile_objects import nearest


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
