"""The faults in an MF4 file: they come back, and a damaged or foreign file costs nothing else."""

import shutil
import struct

import pytest

from hil_bench import RecordingWish, VirtualBench, load_config
from hil_bench.abilities.recording.mdf_blocks import append_events, holds_faults, read_events
from hil_bench.abilities.recording.plot import Span
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.cli import main

FREEZE = "freeze pressure_a, and has changed nothing"


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A recording of 0.2 s at rest, in which a sensor freezes and a wire breaks for good."""
    path = tmp_path_factory.mktemp("faults") / "run.mf4"
    bench = VirtualBench(load_config(), record=RecordingWish((path,)))
    bench.run(0.05)
    bench.faults.freeze("pressure_a", duration=0.05)
    bench.run(0.1)
    bench.faults.break_wire("position")
    bench.run(0.05)
    bench.close()
    return path


def test_a_recording_carries_its_faults(recording):
    freeze, wire = read_events(recording)
    assert (freeze.label, wire.label) == (FREEZE, "break_wire position")
    assert freeze.end - freeze.begin == pytest.approx(0.05)
    assert wire.end == pytest.approx(0.2)  # it lasts until the recording ends
    assert len(read_recording(recording)) == 200


def test_other_tools_find_them_by_the_standard(recording):
    """ASAM MDF 4.1: blocks of identifier, reserved, length and links, each at a multiple of 8.

    The links of an event are the next, its parent, the begin of its range, name and comment; its
    third byte is 1 where a range begins, 2 where it ends; 0 is no link.
    """
    content = recording.read_bytes()
    events, address = {}, 64
    while address < len(content):
        kind, reserved, length, links = struct.unpack_from("<4sIQQ", content, address)
        assert (kind[:2], reserved, address % 8) == (b"##", 0, 0)
        if kind == b"##EV":
            assert (length, links) == (24 + 5 * 8 + 32, 5)
            events[address] = struct.unpack_from("<5Q2xB", content, address + 24)
        address += length + -length % 8
    assert address == len(content)
    first, second, third, fourth = events
    (begun,) = struct.unpack_from("<Q", content, 64 + 24 + 4 * 8)
    assert begun == first
    assert [(event[0], *event[1:3], *event[4:]) for event in events.values()] == [
        (second, 0, 0, 0, 1),
        (third, 0, first, 0, 2),
        (fourth, 0, 0, 0, 1),
        (0, 0, third, 0, 2),
    ]


@pytest.mark.parametrize("words", [[], ["--signals", "axis1.P_*"]])
def test_a_plot_shades_them(recording, tmp_path, words):
    path = tmp_path / "run.svg"
    assert main(["plot", str(recording), "-o", str(path), *words]) == 0
    drawing = path.read_text()
    panels = drawing.count('id="axes_')
    assert panels
    assert drawing.count("fill: #d55e00; opacity: 0.12") == 2 * panels  # the palette's red


def test_a_file_says_whether_its_faults_are_known(make_file, tmp_path, cli):
    """They are written at the end, so a pass by the file of a killed bench is in doubt."""
    recording = tmp_path / "run.mf4"
    bench = VirtualBench(load_config(), record=RecordingWish((recording,)))
    bench.run(0.05)
    assert not holds_faults(recording)
    bench.close()
    ended = recording.read_bytes()
    text = "[[expect]]\nid = 'R'\nthat = 'always position.measured < 200 mm'\n"
    judge = f"judge {make_file('r.toml', text)}"
    assert "faults" not in cli(f"{judge} {recording}").err
    older = make_file("older.mf4", ended.replace(b'name="faults"', b'name="others"'))
    for path in (make_file("k.mf4", ended.replace(b">complete<", b">unknown <")), older):
        assert "it may lack faults: whether one changed nothing" in cli(f"{judge} {path}").err


def test_names_are_anybodys(recording, tmp_path):
    path = shutil.copy(recording, tmp_path / "copy.mf4")
    append_events(path, [Span(0.5, 1.5, "leak \x1b[2J $x_ <b> ü")])
    assert read_events(path) == [Span(0.5, 1.5, "leak \ufffd[2J $x_ <b> ü")]


def test_a_damaged_chain_ends_where_it_is_damaged(recording, make_file):
    content = bytearray(recording.read_bytes())
    place = content.rindex(b"##EV")  # the end of the last one
    content[place : place + 4] = b"####"
    path = make_file("damaged.mf4", content)
    assert [each.label for each in read_events(path)] == [FREEZE]


@pytest.mark.parametrize("address", [1, 7, 1 << 40, (1 << 64) - 1])
def test_an_address_that_leads_nowhere_is_no_event(recording, make_file, address):
    content = bytearray(recording.read_bytes())
    # ASAM MDF 4.1: the HD block is at 64, its fifth link leads to the first event.
    content[64 + 24 + 32 : 64 + 24 + 40] = address.to_bytes(8, "little")
    path = make_file("damaged.mf4", content)
    assert read_events(path) == []


def test_a_chain_that_bites_its_tail_ends(recording, make_file):
    content = bytearray(recording.read_bytes())
    first = int.from_bytes(content[64 + 56 : 64 + 64], "little")
    content[first + 24 : first + 32] = first.to_bytes(8, "little")  # its next one is itself
    path = make_file("ring.mf4", content)
    assert read_events(path) == []
