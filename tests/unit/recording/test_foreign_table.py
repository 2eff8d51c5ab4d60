"""Tables of other tools."""

import struct
import zlib

import numpy as np
import pytest
from scipy.io import savemat
from support.tables import from_text

from hil_bench.abilities.recording import foreign_tables
from hil_bench.abilities.recording.foreign_tables import as_recording, read_columns
from hil_bench.abilities.recording.reading import in_own_units, read_recording
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import recording_channels


def write(directory, text):
    path = directory / "rig.csv"
    path.write_bytes(text.encode())
    return path


@pytest.mark.parametrize(
    "text",
    [
        "t,s [mm]\n0,1.5\n0.1,2.5\n",
        "t,s [mm]\ns,mm\n0,1.5\n0.1,2.5\n",  # a row of units
        "\ufeff# logger 3\r\nt;s [mm]\r\n0;1,5\r\n0,1;2,5\r\n",  # as a German spreadsheet writes it
        "t\ts [mm]\n0\t1.5\n0.1\t2.5\n0.2",  # its writer was killed
    ],
)
def test_the_columns_of_a_csv_file_are_found(tmp_path, text):
    columns, _ = read_columns(write(tmp_path, text))

    assert columns["t"].tolist() == [0.0, 0.1]
    assert columns["s [mm]"].tolist() == [1.5, 2.5]


def test_a_table_of_numbers_is_read_by_rows_of_c(tmp_path, monkeypatch):
    """10^6 rows take 8 s field by field in Python, and 2 s by NumPy's reader."""
    monkeypatch.setattr(foreign_tables, "_read_slowly", None)
    text = "# logger\n\nt;s [mm]\n0;1,5\n\n0,1;2,5\n"

    columns, _ = read_columns(write(tmp_path, text))

    assert columns["t"].tolist() == [0.0, 0.1]
    assert columns["s [mm]"].tolist() == [1.5, 2.5]


@pytest.mark.parametrize(
    ("text", "units"),
    [
        ("t,s [mm]\n0,1.5\n", {"s [mm]": "mm"}),
        ("t,s\ns,mm\n0,1.5\n", {"t": "s", "s": "mm"}),
        ("# logger 3\nt;p (bar)\n;bar\n0;1,5\n", {"t": "", "p (bar)": "bar"}),
        ("t,s\n0,1.5\n", {}),
    ],
)
def test_the_units_of_a_csv_file_are_behind_the_names_or_below(tmp_path, text, units):
    assert read_columns(write(tmp_path, text))[1] == units


@pytest.mark.parametrize("code", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_a_table_of_a_spreadsheet_is_read_in_its_code(tmp_path, code):
    path = tmp_path / "sheet.csv"
    path.write_bytes("sep=;\nt [s];Öl, warm [bar]\n0;1\n0,5;2,5\n".encode(code))
    columns, units = read_columns(path)
    assert {name: values.tolist() for name, values in columns.items()} == {
        "t [s]": [0.0, 0.5],
        "Öl, warm [bar]": [1.0, 2.5],
    }
    assert units == {"t [s]": "s", "Öl, warm [bar]": "bar"}


def test_what_is_no_number_counts_as_none(tmp_path):
    columns, _ = read_columns(write(tmp_path, "t,s\n0,1\n0.1,\n0.2,err\n"))

    assert np.isnan(columns["s"][1:]).all()


@from_text("text", "complaint")
def test_what_is_no_table_is_refused_in_a_line(tmp_path, text, complaint):
    with pytest.raises(ConfigError, match=complaint) as error:
        read_columns(write(tmp_path, f"{text}\n" if text else ""))

    assert "\n" not in str(error.value)


@from_text("text", "expected")
def test_a_table_has_its_names_units_and_times_where_its_tool_has_them(tmp_path, text, expected):
    """In the manner of files of those tools: the second row is at 0.5 s, and its first value 3."""
    columns, units = read_columns(write(tmp_path, f"{text}\n".replace("~", "")))
    recording = as_recording(columns, units)
    channels = recording_channels(recording)
    assert recording_channels(in_own_units(recording))[0] == ("time", "s")
    shown = ", ".join(f"{name} {unit or '-'}" for name, unit in channels[1:])
    assert f"time - {shown}" == expected
    assert in_own_units(recording)["time"][:2].tolist() == [-0.5, 0.5]
    assert recording[channels[1].name][:2].tolist() == [2.0, 3.0]


def test_a_time_of_the_clock_is_refused_with_what_would_be_right(tmp_path):
    text = "No,Time,p [bar]\n1,12:00:00.0,3\n2,12:00:00.1,4\n"
    with pytest.raises(ConfigError, match=r"its time, Time, is no number .* 43201.5 for 12:00:01"):
        read_recording(write(tmp_path, text))


def test_a_table_that_begins_as_ours_may_be_in_another_code(tmp_path):
    path = tmp_path / "rig.csv"
    path.write_bytes("time,T\ns,°C\n0,20\n".encode("latin-1"))
    assert recording_channels(read_recording(path))[1] == ("T", "°C")


def test_a_log_of_frames_is_no_table(make_file):
    path = make_file("bus.log", "(1.0) can0 123#11\n")
    with pytest.raises(ConfigError, match=r"holds no signals.* 'hil-bench decode .*bus.log"):
        read_recording(path)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("t;p\n0;1.234\n1;2.345\n", [1.234, 2.345]),  # one mark, with three decimals
        ("t;p\n0;1,234\n1;2,345\n", [1.234, 2.345]),
        ("t;p\n0,5;0.234\n1,5;12.5\n", [0.234, 12.5]),  # no group begins with 0 or has one digit
    ],
)
def test_three_decimals_are_no_thousands(tmp_path, text, expected):
    assert read_columns(write(tmp_path, text))[0]["p"].tolist() == expected


def test_the_vectors_of_a_mat_file_are_columns(tmp_path):
    path = tmp_path / "rig.mat"
    savemat(path, {"t": np.arange(5.0), "s": np.arange(5)[:, np.newaxis], "note": "x", "k": 3.0})

    columns, _ = read_columns(path)

    assert sorted(columns) == ["s", "t"]
    assert columns["s"].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]


@pytest.mark.parametrize("content", [b"", b"MATLAB 5.0 MAT-file" + bytes(200), b"\x89HDF" * 40])
def test_a_broken_mat_file_is_refused_in_a_line(make_file, content):
    path = make_file("rig.mat", content)

    with pytest.raises(ConfigError, match="is no recording") as error:
        read_columns(path)

    assert "\n" not in str(error.value)


def test_a_mat_file_does_not_fill_the_memory(tmp_path):
    """A vector that claims 4 GiB less a few bytes: element 14, a matrix of doubles."""
    path = tmp_path / "rig.mat"
    savemat(path, {"t": np.arange(5.0)})
    count = (1 << 29) - 100
    head = struct.pack("<10L", 6, 8, 6, 0, 5, 8, count, 1, 1 << 16 | 1, ord("t"))
    claim = struct.pack("<2L", 9, 8 * count)
    matrix = struct.pack("<2L", 14, len(head + claim) + 8 * count) + head + claim
    packed = zlib.compress(matrix + bytes(1 << 16))
    path.write_bytes(path.read_bytes()[:128] + struct.pack("<2L", 15, len(packed)) + packed)
    with pytest.raises(ConfigError, match=r"is no recording: it is no MAT file: .* over 4 GiB"):
        read_columns(path)


def test_a_mat_file_that_ends_its_reader_is_refused_in_a_line(tmp_path):
    """The type of the first vector's data, bytes 176 to 179, is 0: scipy 1.16 reads beyond it."""
    path = tmp_path / "rig.mat"
    savemat(path, {"t": np.arange(5.0), "s": np.arange(5.0)})
    content = path.read_bytes()
    path.write_bytes(content[:176] + bytes(4) + content[180:])
    with pytest.raises(ConfigError, match="is no recording: it is no MAT file") as error:
        read_columns(path)
    assert str(error.value).isprintable()
