import struct

import numpy as np
import pytest

from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import Channel, ChannelRecorder, recording_channels

CHANNELS = (Channel("axis1.position", "m"), Channel("axis1.P_A", "Pa"))


def record(rows, capacity):
    recorder = ChannelRecorder(CHANNELS, capacity)
    for row in range(rows):
        recorder.append((row * 1e-3, float(row), -float(row)))
    return recorder.result().tolist()


def expected(first, after):
    return [(row * 1e-3, float(row), -float(row)) for row in range(first, after)]


@pytest.mark.parametrize(
    ("rows", "first"), [(0, 0), (1, 0), (3, 0), (4, 0), (5, 1), (7, 3), (8, 4), (11, 7)]
)
def test_the_ring_keeps_the_newest_rows_in_the_order_of_time(rows, first):
    assert record(rows, capacity=4) == expected(first, rows)


def test_a_result_has_time_first_and_a_unit_for_each_field():
    recorder = ChannelRecorder(CHANNELS, 10)
    recorder.append((0.5, 0.1, 5e6))
    result = recorder.result()

    assert result.dtype.names == ("time", "axis1.position", "axis1.P_A")
    assert recording_channels(result) == (Channel("time", "s"), *CHANNELS)
    assert result["axis1.P_A"].dtype.metadata == {"unit": "Pa"}
    assert result["axis1.P_A"].tolist() == [5e6]


def test_a_slice_of_a_result_keeps_its_units():
    recorder = ChannelRecorder(CHANNELS, 10)
    for row in range(10):
        recorder.append((float(row), 0.0, 0.0))

    assert recording_channels(recorder.result()[2:5]) == recorder.channels
    assert recording_channels(recorder.result()[["time", "axis1.P_A"]]) == (
        Channel("time", "s"),
        Channel("axis1.P_A", "Pa"),
    )


def test_a_result_is_a_copy():
    recorder = ChannelRecorder(CHANNELS, 2)
    recorder.append((0.0, 1.0, 2.0))
    result = recorder.result()
    recorder.append((1.0, 3.0, 4.0))
    recorder.append((2.0, 5.0, 6.0))

    assert result.tolist() == [(0.0, 1.0, 2.0)]


def test_a_row_of_the_wrong_length_is_refused():
    with pytest.raises(struct.error, match="expected 3 items"):
        ChannelRecorder(CHANNELS, 2).append((0.0, 1.0))


@pytest.mark.parametrize(
    ("channels", "capacity", "message"),
    [
        (CHANNELS, 0, "recording capacity: 0 rows hold nothing; give 1 or more"),
        (
            (*CHANNELS, CHANNELS[0]),
            1,
            "recording channel axis1.position: is there twice; give each its own name",
        ),
        (
            (Channel("time", "s"),),
            1,
            "recording channel time: is there twice; give each its own name",
        ),
    ],
)
def test_a_recorder_that_makes_no_sense_is_refused(channels, capacity, message):
    with pytest.raises(ConfigError) as caught:
        ChannelRecorder(channels, capacity)

    assert str(caught.value) == message


def test_append_allocates_nothing_that_stays():
    recorder = ChannelRecorder(CHANNELS, 4)
    rows = recorder._rows
    for row in range(9):
        recorder.append((float(row), 0.0, 0.0))

    assert recorder._rows is rows
    assert np.shares_memory(recorder._rows, rows)
