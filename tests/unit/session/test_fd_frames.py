"""A bench on a bus of CAN FD: its devices neither hear such frames nor lose classical ones."""

from pathlib import Path

import can
import pytest

from hil_bench import VirtualBench, load_config, read_frames
from hil_bench.abilities.common.shared_ring import MOST_FRAMES, pack_frames, unpack_frames
from hil_bench.abilities.copper.wire.bits import exact_fd_bits
from hil_bench.canopen_device.frame import BRS, FDF, Frame

FD_BUS = {"bus": {"bitrate": 500_000, "fd": True, "data_bitrate": 2_000_000}}
START = bytes((1, 0))
LONG = bytes(range(64))


def message(can_id, data=b"", **fields):
    return can.Message(arbitration_id=can_id, is_extended_id=False, data=data, **fields)


def heartbeats(bench):
    """Return the state that each heartbeat says, by node-ID."""
    return {
        logged.frame.can_id & 0x7F: logged.frame.data[0]
        for logged in bench.frames
        if logged.frame.can_id & 0x780 == 0x700 and not logged.is_received
    }


def heard_of(node_id):
    """An SDO download of the heartbeat time 0x1017 := 10 ms."""
    return message(0x600 + node_id, bytes.fromhex("2B1710000A000000"))


def test_no_device_hears_can_fd_whatever_its_identifier():
    """NMT start, an SDO request and SYNC as CAN FD; then the same as classical frames."""
    with VirtualBench(load_config(tables=FD_BUS)) as bench:
        bench.run(0.01)
        bench.bus.send(heard_of(1))
        bench.run(0.05)
        for can_id, data in ((0x000, START), (0x601, bytes.fromhex("4000100000000000"))):
            bench.bus.send(message(can_id, data, is_fd=True))
        bench.bus.send(message(0x080, is_fd=True))
        bench.run(0.05)
        assert heartbeats(bench)[1] == 0x7F  # pre-operational (CiA 301, 7.2.8.3.2.2)
        assert sum(each.frame.can_id == 0x581 for each in bench.frames) == 1  # of the download
        bench.bus.send(message(0x000, START))
        bench.run(0.05)
        assert heartbeats(bench)[1] == 0x05  # operational


def test_a_recording_holds_both_kinds(tmp_path):
    path = tmp_path / "r.mf4"
    with VirtualBench(load_config(tables=FD_BUS), record=path) as bench:
        bench.bus.send(message(0x123, LONG, is_fd=True, bitrate_switch=True))
        bench.run(0.01)
        bench.bus.send(message(0x124, b"\x01"))
        bench.run(0.01)
    received = [each.frame for each in read_frames(path) if each.is_received]
    assert received == [Frame(0x123, LONG, fd=FDF | BRS), Frame(0x124, b"\x01")]


def test_a_classical_bench_refuses_can_fd_in_a_line():
    with VirtualBench() as bench, pytest.raises(can.CanOperationError) as caught:
        bench.bus.send(message(0x123, LONG, is_fd=True))
    assert str(caught.value).startswith(
        "embedded: the bus is classical CAN; fd = true in bench.toml"
    )


def test_on_copper_a_frame_takes_both_bit_rates():
    tables = {"bus": FD_BUS["bus"] | {"wire": {}}}
    with VirtualBench(load_config(tables=tables)) as bench:
        bench.run(0.1)  # the boot-up messages pass
        begin = round(bench.now() * 1e9)
        bench.bus.send(message(0x123, LONG, is_fd=True, bitrate_switch=True))
        bench.run(0.01)
        (logged,) = [each for each in bench.frames if each.frame.fd and each.now > begin]
    slow, fast = exact_fd_bits(logged.frame)
    assert logged.now - begin == slow * 2000 + fast * 500


def test_frames_go_through_shared_memory_with_their_bits_and_in_their_order():
    frames = [
        Frame(0x181, b"\x01"),
        Frame(0x123, LONG, bus=3, fd=FDF | BRS),
        Frame(0x124, LONG[:12], is_extended=True, fd=FDF),
        Frame(0x701, is_remote=True, bus=7),
        *[Frame(0x200 + n % 8) for n in range(MOST_FRAMES)],
    ]
    messages = [*pack_frames(frames, 5, is_received=True)]
    assert [*map(len, messages)][:3] == [1 + 23, 1 + 79, 1 + 79]
    found = [each for packed in messages for each in unpack_frames(packed)]
    assert found == [(frame, 5, True) for frame in frames]


def test_a_data_bit_rate_needs_can_fd_and_is_not_below_the_bit_rate(tmp_path):
    path = Path(tmp_path / "bench.toml")
    for text, wrong in (
        ("data_bitrate = 2_000_000", "bus.data_bitrate: the bus is classical"),
        ("fd = true\ndata_bitrate = 100_000", "bus.data_bitrate: 100000 is less than the bit rate"),
        ("fd = 1", "bus.fd: 1 is not a truth value"),
    ):
        path.write_text(f"[bus]\n{text}\n")
        with pytest.raises(ValueError, match=wrong):
            load_config(path)
