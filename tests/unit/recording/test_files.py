import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.tables import from_text

from hil_bench.abilities.common.block_file import RecordingFile
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import (
    Channel,
    ChannelRecorder,
    recording_channels,
    recording_dtype,
)

CHANNELS = (Channel("axis1.position", "m"), Channel("axis1.spool_position", "-"))


def recording(*rows):
    recorder = ChannelRecorder(CHANNELS, max(len(rows), 1))
    for row in rows:
        recorder.append(row)
    return recorder.result()


def write(path, content):
    with RecordingFile(path) as file:
        file.write(content)


def test_names_stand_in_the_first_row_and_units_in_the_second(tmp_path):
    path = tmp_path / "run.csv"
    write(path, recording((0.0, 0.1, -1.0), (0.001, 1e-17, 0.5)))

    assert path.read_text(encoding="utf-8").splitlines() == [
        "time,axis1.position,axis1.spool_position",
        "s,m,-",
        "0.0,0.1,-1.0",
        "0.001,1e-17,0.5",
    ]


@given(values=st.lists(st.tuples(*[st.floats(allow_nan=False)] * 3), max_size=5))
def test_what_was_written_reads_back_exactly(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("recording") / "run.csv"
    write(path, recording(*values))
    found = read_recording(path)

    assert found.tolist() == values
    assert recording_channels(found) == (Channel("time", "s"), *CHANNELS)


def test_not_a_number_reads_back(tmp_path):
    path = tmp_path / "run.csv"
    write(path, recording((0.0, math.nan, math.inf)))

    assert np.isnan(read_recording(path)["axis1.position"]).all()


def test_names_with_separators_and_quotes_read_back(tmp_path):
    channels = (Channel("time", "s"), Channel('a,"b"', 'chain, "Gunter"'))
    path = tmp_path / "run.csv"
    write(path, np.zeros(1, dtype=recording_dtype(channels)))

    assert recording_channels(read_recording(path)) == channels


def test_the_file_is_not_there_before_it_is_whole(tmp_path, make_file):
    path = make_file("run.csv", "time of the last good run")
    with RecordingFile(path) as file:
        assert path.read_text() == "time of the last good run"
        file.write(recording((0.0, 1.0, 2.0)))

    assert read_recording(path).tolist() == [(0.0, 1.0, 2.0)]
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.csv"]


def test_a_run_that_fails_leaves_the_last_file_alone(tmp_path, make_file):
    path = make_file("run.csv", "time of the last good run")
    with pytest.raises(RuntimeError), RecordingFile(path):
        raise RuntimeError

    assert path.read_text() == "time of the last good run"
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.csv"]


def test_a_full_disk_is_told_with_the_file(tmp_path):
    path = tmp_path / "run.csv"
    (tmp_path / "run.csv.part").symlink_to("/dev/full")
    with pytest.raises(OSError, match="No space left") as caught, RecordingFile(path) as file:
        file.write(recording((0.0, 1.0, 2.0)))

    assert caught.value.filename == str(path)
    assert list(tmp_path.iterdir()) == []


def test_a_path_that_cannot_be_written_is_refused_at_once(tmp_path):
    with pytest.raises(ConfigError) as missing:
        RecordingFile(tmp_path / "no" / "run.csv")
    with pytest.raises(ConfigError) as directory:
        RecordingFile(tmp_path)

    assert str(missing.value) == (
        f"{tmp_path}/no/run.csv: there is no folder {tmp_path}/no; make it first"
    )
    assert str(directory.value) == f"{tmp_path}: is a directory; give the name of a file to write"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "it has no row of numbers"),
        ("time\n", "it has no row of numbers"),
        ("time,x\ns\n", "it has 2 names and 1 units"),
        ("time,time\ns,s\n", "recording channel time: is there twice; give each its own name"),
        ("time,x\ns,m\n1\n", "row 3 has 1 values, the first has 2"),
        (
            "time,x\ns,m\n1,fast\n",
            'row 3, column x: "fast" is not a number; write nan for an unknown value',
        ),
        ("time,x\ns,m\n1,2\n2,\n", "row 4, column x: is empty; write nan for an unknown value"),
        ("x,time\nm,s\n", "it has no row of numbers"),
        ("\n\n", "it has no row of numbers"),
    ],
)
def test_a_file_that_is_no_recording_says_why(make_file, text, reason):
    path = make_file("run.csv", text)
    with pytest.raises(ConfigError) as caught:
        read_recording(path)

    assert str(caught.value) == f"{path}: is no recording: {reason}"


@pytest.mark.parametrize(
    "text",
    [
        "time [ms],axis1.P_A [bar]\n0,1\n10,\n",
        "Time,axis1.P_A\nms,bar\n0,1\n10,-\n",
        "logger 7\n\naxis1.P_A (bar);Zeit (ms)\n1,0;0\n;1,0e1\n",  # a comma in the numbers
        "t [s]\taxis1.P_A [bar]\n0\t1\n0.01\tERR\n0.02\t2",  # its writer was killed
        "x,axis1.P_A\nsecond,bar\n+0.0E+00,+1.0E+00\n+1.0E-02,\n",  # an oscilloscope's
        (
            "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\t\n"
            "Channels\t1\nX0\t0,0\n"
            "***End_of_Header***\t\nt [s]\taxis1.P_A [bar]\tComment\n0,0\t1,0\n0,01\t\n"
        ),
    ],
)
def test_a_table_of_another_tool_is_a_recording(make_file, text):
    path = make_file("run.csv", text)
    found = read_recording(path)

    assert recording_channels(found) == (Channel("time", "s"), Channel("axis1.P_A", "Pa"))
    assert found["time"].tolist() == [0.0, 0.01]
    np.testing.assert_array_equal(found["axis1.P_A"], [1e5, math.nan])


@from_text("text", "wrong")
def test_a_table_of_another_tool_that_is_none_says_why(make_file, text, wrong):
    path = make_file("run.csv", f"{text}\n")
    with pytest.raises(ConfigError) as caught:
        read_recording(path)

    assert str(caught.value).startswith(f"{path}: {wrong}")


def test_a_binary_file_is_no_recording(make_file):
    path = make_file("run.csv", b"\xff\x00\xff")
    with pytest.raises(ConfigError, match="is no recording: "):
        read_recording(path)


def test_a_missing_recording_says_so(tmp_path):
    with pytest.raises(ConfigError) as caught:
        read_recording(tmp_path / "no.csv")

    assert str(caught.value) == (
        f"{tmp_path}/no.csv: cannot be read: No such file or directory; give a recording"
    )
