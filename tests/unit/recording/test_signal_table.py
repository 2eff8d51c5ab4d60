"""Signals in a notebook, with pandas and as a figure; the numbers stay those of the array."""

import re
import subprocess
import sys

import numpy as np
import pytest

import hil_bench
from hil_bench import VirtualBench, open_recording
from hil_bench.outside.recording.channels import Channel, recording_dtype
from hil_bench.outside.recording.signal_table import SignalTable, as_table


@pytest.fixture
def table():
    channels = (Channel("time", "s"), Channel("a.P_A", "Pa"), Channel("<b>", "-"))
    rows = [(0.001 * number, 1e5 + number, -1.0) for number in range(12)]
    return as_table(np.array(rows, dtype=recording_dtype(channels)))


def test_a_field_is_a_plain_array_and_rows_are_a_table(table):
    assert type(table["a.P_A"]) is np.ndarray
    assert table["a.P_A"].max() == 1e5 + 11
    assert isinstance(table[2:4], SignalTable)
    assert table[table["time"] > 0.0095].tolist() == [(0.010, 100010.0, -1.0), (0.011, 100011, -1)]
    assert table.units == {"time": "s", "a.P_A": "Pa", "<b>": "-"}


def test_a_name_that_no_signal_has_is_refused_with_the_nearest(table):
    with pytest.raises(ValueError, match=r'^no signal "a\.P_a"; the nearest is a\.P_A$'):
        table["a.P_a"]


def test_pandas_gets_columns_units_and_time_as_index(table):
    frame = table.to_pandas()

    assert frame.index.name == "time"
    assert list(frame.columns) == ["a.P_A", "<b>"]
    assert frame.loc[0.002, "a.P_A"] == 100002.0
    assert frame.attrs["units"]["a.P_A"] == "Pa"


def test_a_notebook_shows_names_units_and_both_ends(table):
    page = table._repr_html_()

    assert page.count("<tr>") == 2 + 5 + 5
    assert "<th>&lt;b&gt;</th>" in page
    assert "<th>[Pa]</th>" in page
    assert re.findall(r"<tr><td>([\d.]+)", page)[-1] == "0.011"
    assert page.endswith("<p>12 rows</p>")


def test_it_is_drawn():
    with VirtualBench() as bench:
        bench.run(0.01)
        motion, pressures = bench.signals.plot(), bench.signals.plot("axis1.P_*")

    assert [place.get_ylabel() for place in motion.axes] == [
        "Position [mm]",
        "Pressure [bar]",
        "Spool [%]",
    ]
    (place,) = pressures.axes
    assert [line.get_label() for line in place.lines] == ["axis1.P_A", "axis1.P_B"]


def test_a_recording_is_opened(tmp_path):
    path = tmp_path / "run.mf4"
    with VirtualBench(record=path) as bench:
        bench.run(0.01)
        expected = bench.signals
    assert open_recording(str(path)).tolist() == expected.tolist()


NAMES_BELOW = {"HilBenchError": "DeviceError"}  # in canopen_device, which knows no bench


def test_the_package_exports_its_public_names_and_imports_none_before_use():
    for name in hil_bench.__all__:
        assert getattr(hil_bench, name).__name__ == NAMES_BELOW.get(name, name)
    with pytest.raises(AttributeError, match="no attribute 'Bench'"):
        hil_bench.Bench  # noqa: B018 - it raises
    script = "import sys, hil_bench; print('numpy' in sys.modules, len(dir(hil_bench)) > 10)"
    done = subprocess.run(  # noqa: S603 - a script of our own
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout == "False True\n"
