"""Frames that nobody should send: any, and more often those that mean something."""

from hypothesis import strategies as st

from hil_bench.canopen_device.frame import BRS, FDF, Frame

ANY_FRAME = st.builds(
    Frame,
    st.one_of(
        st.sampled_from([0x000, 0x080, 0x100, 0x201, 0x601, 0x604, 0x701, 0x7E4, 0x7E5]),
        st.integers(0, 0x7FF),
    ),
    st.binary(max_size=8),
    st.booleans() | st.just(value=False),
    st.booleans() | st.just(value=False),
    st.integers(0, 8) | st.just(0),
    st.sampled_from([0, 0, FDF | BRS]),
)
