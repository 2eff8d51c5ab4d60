"""Error frames in logs; the layout is that of SocketCAN's `linux/can/error.h`."""

import pytest

from hil_bench import VirtualBench, load_config
from hil_bench.abilities.copper.extension import Copper
from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.explain import explain
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.abilities.eyes.frame_words import error_text
from hil_bench.abilities.recording.frames import LeftOut, read_frames
from hil_bench.canopen_device.frame import Frame
from hil_bench.frame import ERROR_FLAG, is_error_frame
from hil_bench.outside.transports.socketcan import pack_frame, unpack_frame

# CAN_ERR_PROT | CAN_ERR_BUSERROR | CAN_ERR_CNT, CAN_ERR_PROT_STUFF, TEC 0 and REC 1
STUFF = Frame(ERROR_FLAG | 0x288, bytes((0, 0, 4, 0, 0, 0, 0, 1)))


@pytest.fixture(params=[".log", ".asc", ".blf", ".mf4"])
def log(request, tmp_path):
    """Record a bench whose valve has two bit errors, and return the file."""
    path = tmp_path / f"trace{request.param}"
    tables = {"bus": {"bitrate": 125_000, "wire": {}}}
    with VirtualBench(load_config(tables=tables), record=path) as bench:
        with bench.faults.bit_error("valve"):
            bench.run(0.004)
        bench.run(0.05)
        wire = bench.bench.part(Copper).wiring.buses[0].wire
        assert wire.failed >= 2
    return path, wire.failed


def test_a_recording_has_them(log):
    path, failed = log
    frames = [each.frame for each in read_frames(path, errors=True)]
    errors = [frame for frame in frames if is_error_frame(frame)]
    assert len(errors) == failed
    if path.suffix in {".log", ".mf4"}:
        assert errors[0] == STUFF


def test_they_are_left_out_and_counted_for_who_does_not_ask(log):
    path, failed = log
    left_out = LeftOut()
    frames = [each.frame for each in read_frames(path, left_out)]
    assert not any(map(is_error_frame, frames))
    assert left_out.error_frames == failed


def test_explain_finds_them_first(make_file):
    path = make_file(
        "trace.log",
        "(0.000000) can0 701#00\n"
        "(0.000500) can0 20000288#0000040000000001\n"
        "(0.000600) can0 20000204#0030000000008000\n"
        "(0.001000) can0 701#7F\n",
    )
    found = explain(read_frames(path, errors=True), (), 125_000)
    (finding,) = (each for each in found.findings if each.cause is Cause.ERROR_FRAMES)
    assert finding.text == (
        "2 error frames, the first at 0.001 s: stuff error while receiving, TEC 0, REC 1"
    )


def test_error_frames_in_words():
    expected = {
        (0x288, "0000810000000800"): "bit error while sending, TEC 8, REC 0",
        (0x2A8, "0000810000008000"): "no acknowledge, bit error while sending, TEC 128, REC 0",
        (0x244, "0020000000008000"): "bus-off, error-passive by transmission, TEC 128, REC 0",
        (0x040, ""): "bus-off",
        (0x000, ""): "error frame",
    }
    assert {
        (can_id, data): error_text(Frame(ERROR_FLAG | can_id, bytes.fromhex(data)))
        for can_id, data in expected
    } == expected


def test_a_sight_of_one_is_a_problem():
    class Logged:
        now, frame = 0, STUFF

    (sight,) = Decoder().take(Logged)
    assert sight.text == "! stuff error while receiving, TEC 0, REC 1"


def test_on_socketcan_they_have_the_flag_and_no_device_gets_them():
    raw = pack_frame(STUFF)
    assert raw[:4] == (0x2000_0288).to_bytes(4, "little")
    assert unpack_frame(raw) is None


@pytest.mark.parametrize(
    "line", ["(1) can0 20000288#00", "(9e9) can0 20000288#0", "(1.0) x 2FFFFFFF#"]
)
def test_a_damaged_line_is_counted_or_read_and_nothing_else(make_file, line):
    path = make_file("trace.log", f"(0.000000) can0 701#00\n{line}\n(0.001000) can0 701#7F\n")
    frames = list(read_frames(path, left_out := LeftOut(), errors=True))
    assert sum(not is_error_frame(each.frame) for each in frames) == 2
    assert len(frames) - 2 + left_out.error_frames == 1
