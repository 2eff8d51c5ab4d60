"""Our frames as an independent dissector reads them: Wireshark's, in virtual time."""

import struct
from collections import Counter

import pytest
from support.dissection import dissect, require_tshark, write_capture

from hil_bench.bench.virtual_bench import VirtualBench
from hil_drivers import Network, PositionSensor, PressureSensor, ProportionalValve

pytestmark = pytest.mark.usefixtures("_tshark")


@pytest.fixture
def _tshark():
    require_tshark()


@pytest.fixture
def sent(laboratory):
    """All that the device sends while the whole suite asks for every service."""
    frames = []

    def record(frame):
        frames.append((laboratory.bus.now(), frame))
        return [frame]

    laboratory.says = record
    laboratory.run()
    return frames


def dissected_soundly(path):
    """Return how many frames a capture has, all of them sound CANopen."""
    rows = dissect(path, "frame.protocols", "_ws.malformed", "can.len")
    # What has no data, such as SYNC, is not handed to the dissector.
    assert {row[0].split(":")[-1] for row in rows if row[2] != "0"} == {"canopen"}
    assert [row for row in rows if row[1]] == []
    return len(rows)


def test_no_frame_of_the_device_is_malformed(sent, tmp_path):
    path = tmp_path / "suite.pcap"
    write_capture(path, sent)
    assert len(sent) > 1000
    assert dissected_soundly(path) == len(sent)


def test_a_malformed_frame_would_be_found(sent, tmp_path):
    path = tmp_path / "suite.pcap"
    short = next(frame for _, frame in sent if frame.can_id == 0x085)
    write_capture(path, [(0.0, short._replace(data=short.data[:4]))])
    assert dissect(path, "frame.number", only="_ws.malformed") == [("1",)]


def test_it_reads_the_states_errors_and_aborts_that_were_meant(sent, tmp_path):
    path = tmp_path / "suite.pcap"
    write_capture(path, sent)

    states = Counter(int(row[0], 16) for row in dissect(path, "canopen.nmt_guard.state") if row[0])
    assert states == Counter(f.data[0] & 0x7F for _, f in sent if f.can_id == 0x705)

    errors = dissect(path, "canopen.em.err_code", "canopen.em.err_reg", only="canopen.em.err_code")
    expected = [struct.unpack_from("<HB", f.data) for _, f in sent if f.can_id == 0x085]
    assert [(int(code, 16), int(register, 16)) for code, register in errors] == expected

    # It does not follow transfers, and takes the last segment of a block for an abort, too.
    only = "canopen.sdo.abort_code && canopen.sdo.cmd == 0x80"
    codes = Counter(int(row[0], 16) for row in dissect(path, "canopen.sdo.abort_code", only=only))
    aborts = Counter(
        struct.unpack_from("<I", f.data, 4)[0]
        for _, f in sent
        if f.can_id == 0x585 and f.data[0] == 0x80
    )
    assert codes == aborts
    assert {0x05030000, 0x05040000, 0x06020000, 0x06090011} <= set(codes)


def test_no_frame_of_a_controlled_bench_is_malformed(tmp_path):
    with VirtualBench() as bench, Network(bench.bus, clock=bench.now) as network:
        bench.pump = network.pump
        valve, position = ProportionalValve(network, 1), PositionSensor(network, 4)
        devices = valve, position, PressureSensor(network, 2), PressureSensor(network, 3)
        for device in devices:
            device.setup(transmission_type=254, event_timer=0.01)
            network.start_node(device.node.id)
        valve.enable()
        for _ in range(20):
            valve.spool_setpoint = 0.5
            network.pump_until(network.now() + 0.01)
        network.sync()
        network.reset_node(4)
        frames = [(logged.now * 1e-9, logged.frame) for logged in bench.frames]
    path = tmp_path / "bench.pcap"
    write_capture(path, frames)
    assert dissected_soundly(path) == len(frames)
