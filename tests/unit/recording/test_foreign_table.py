"""Tables of other tools."""

import struct
import zlib

import numpy as np
import pytest
from scipy.io import savemat
from support.tables import from_text

from hil_bench.abilities.recording import reading
from hil_bench.abilities.recording.reading import read_columns
from hil_bench.errors import ConfigError


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
    monkeypatch.setattr(reading, "_read_slowly", None)
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
