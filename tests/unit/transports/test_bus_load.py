import pytest

from hil_bench.outside.bits import WINDOW, BusLoad, bitrate_text, load_of

TENTH = WINDOW // 10


def test_a_load_is_the_share_of_the_time_that_the_bits_take():
    assert load_of(125_000, 500_000_000, 500_000) == pytest.approx(0.5)  # 0.25 s of 0.5 s
    assert load_of(0, 0, 500_000) == 0.0


def test_the_present_load_is_that_of_the_last_second():
    load = BusLoad(bitrate=1_000_000)
    assert load.update(0, 0.0) == 0.0
    # 10,000 bits in the first tenth, 10 ms of 100.
    assert load.update(TENTH, 10_000) == pytest.approx(0.1)
    assert load.update(TENTH + 1, 99_999) == pytest.approx(0.1)  # until the next tenth
    # Ten tenths later the first one is out, and nothing came since.
    for tenth in range(2, 12):
        latest = load.update(tenth * TENTH, 10_000)
    assert latest == 0.0


def test_a_bit_rate_for_people():
    expected = {1_000_000: "1 Mbit/s", 500_000: "500 kbit/s", 83_333: "83.333 kbit/s"}
    assert {bitrate: bitrate_text(bitrate) for bitrate in expected} == expected
