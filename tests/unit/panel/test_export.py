"""What the scope shows, as MF4: made of what a page sends."""

import json
import struct
import urllib.error
import urllib.request

import numpy as np
import pytest
from support.live_bench import SECRET, panel, runtime_folder

from hil_bench.abilities.panel import record
from hil_bench.abilities.panel.record import make_mf4
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.errors import ConfigError

ROWS = struct.pack("<6d", 0.5, 1e5, -0.25, 0.501, float("nan"), 0.125)


def body(channels, rows=ROWS, comment="scope"):
    head = json.dumps({"comment": comment, "channels": channels})
    return head.encode() + b"\n" + rows


def test_the_rows_come_back_with_names_and_units(tmp_path):
    path = tmp_path / "scope.mf4"
    channels = [["axis1.P_A", "Pa"], ["<b>&", "m"]]
    path.write_bytes(make_mf4(body(channels, comment="<i>&")))
    table = read_recording(path)
    assert table.dtype.names == ("time", "axis1.P_A", "<b>&")
    np.testing.assert_array_equal(table["time"], [0.5, 0.501])
    np.testing.assert_array_equal(table["axis1.P_A"], [1e5, np.nan])
    np.testing.assert_array_equal(table["<b>&"], [-0.25, 0.125])


def test_no_rows_are_a_file_without_rows(make_file):
    path = make_file("scope.mf4", make_mf4(body([["a", "m"]], b"")))
    assert len(read_recording(path)) == 0


@pytest.mark.parametrize(
    "wrong",
    [
        b"",
        b"[1]\n",
        b"[" * 50_000,
        b"\xff\n",
        b'{"comment": "", "channels": 3}\n',
        b'{"comment": "", "channels": [["a"]]}\n',
        body([["a", 3]]),
        body([["a\x00", "m"]]),
        body([["a" * 201, "m"]]),
        body([["a", "m"], ["a", "m"]]),
        body([["time", "s"]]),
        body([[str(number), "m"] for number in range(1001)]),
        body([["a", "m"], ["b", "m"]], ROWS[:-1]),
    ],
)
def test_anything_else_is_refused_in_a_line(wrong):
    with pytest.raises(ConfigError, match=r"^mf4: give [^\n]*$"):
        make_mf4(wrong)


@pytest.fixture
def port(monkeypatch):
    with runtime_folder(monkeypatch), panel() as port:
        yield port


def post(port, content, secret=SECRET):
    request = urllib.request.Request(
        f"http://127.0.0.1:{port}/mf4",
        content,
        {"Origin": f"http://127.0.0.1:{port}", "Authorization": f"Bearer {secret}"},
    )
    try:
        with urllib.request.urlopen(request) as answer:  # noqa: S310 - likewise
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read()


def test_a_page_with_the_secret_gets_the_file(port):
    status, content = post(port, body([["a", "m"], ["b", "m"]]))
    assert (status, content[:3]) == (200, b"MDF")


def test_others_get_nothing(port, monkeypatch):
    assert post(port, body([["a", "m"]]), "wrong")[0] == 401
    assert post(port, body([["a", "m"]]), "\xe4")[0] == 401
    monkeypatch.setattr("hil_bench.abilities.panel.app.MOST_BYTES", 1 << 20)
    status, words = post(port, b"x" * ((1 << 20) + 1))
    assert (status, words) == (400, b"mf4: more than 1 MiB; zoom in, or choose less")
    assert record.MOST_BYTES == 1 << 26
