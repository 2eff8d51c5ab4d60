import pytest

from hil_bench.frame import FRAME_BITS, frame_bits


@pytest.mark.parametrize(
    ("length", "is_extended", "low", "high"),
    [
        # ISO 11898-1: 44 bits and 8 a byte, 3 between frames; at most (34 + 8 n - 1) // 4 more.
        (0, False, 47, 55),
        (8, False, 111, 135),
        (8, True, 131, 160),
    ],
)
def test_the_bits_of_a_frame_lie_between_none_and_all_stuff_bits(length, is_extended, low, high):
    assert frame_bits(length, is_extended=is_extended) == pytest.approx((low + high) / 2, abs=0.5)


def test_the_bits_by_length_are_those_of_an_11_bit_identifier():
    assert FRAME_BITS[0] == frame_bits(0)
    assert FRAME_BITS[8] == frame_bits(8)
    assert len(FRAME_BITS) == 9
