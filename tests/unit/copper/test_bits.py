"""Lengths of frames to the bit, beside a second way to count and the bounds of the standard."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.abilities.copper.wire.bits import exact_bits
from hil_bench.abilities.eyes.traffic import worst_bits
from hil_bench.canopen_device.frame import Frame


def counted(frame):
    """Count by text: the polynomial division on paper, and stuffing as a substitution."""
    if frame.is_extended:
        identifier = f"{frame.can_id:029b}"
        head = f"0{identifier[:11]}11{identifier[11:]}{frame.is_remote:d}00"
    else:
        head = f"0{frame.can_id:011b}{frame.is_remote:d}00"
    bits = f"{head}{len(frame.data):04b}" + "".join(f"{byte:08b}" for byte in frame.data)
    # x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1
    divisor, rest = 0b1100010110011001, int(bits + 15 * "0", 2)
    while rest.bit_length() >= 16:
        rest ^= divisor << rest.bit_length() - 16
    bits += f"{rest:015b}"
    stuffed = ""
    for bit in bits:
        stuffed += bit
        if run := re.search(r"(0{5}|1{5})$", stuffed):
            stuffed += "1" if run[1][0] == "0" else "0"
    return len(stuffed) + 1 + 2 + 7 + 3


frames = st.one_of(
    st.builds(Frame, st.integers(0, 0x7FF), st.binary(max_size=8), fd=st.just(0)),
    st.builds(Frame, st.integers(0, 0x7FF), st.just(b""), is_remote=st.just(True), fd=st.just(0)),
    st.builds(
        Frame,
        st.integers(0, 0x1FFFFFFF),
        st.binary(max_size=8),
        is_extended=st.just(True),
        fd=st.just(0),
    ),
)


@given(frames)
def test_a_frame_has_the_bits_that_paper_counts(frame):
    bits = exact_bits(frame)
    assert bits == counted(frame)
    if not frame.is_remote:
        assert bits <= worst_bits(len(frame.data), is_extended=frame.is_extended)


# Davis et al. 2007, section 2.1: 135 and 160 bits at 8 bytes; 55 + 10 s and 80 + 10 s.
@pytest.mark.parametrize("length", range(9))
def test_the_bound_is_that_of_the_paper(length):
    assert worst_bits(length) == 55 + 10 * length
    assert worst_bits(length, is_extended=True) == 80 + 10 * length
