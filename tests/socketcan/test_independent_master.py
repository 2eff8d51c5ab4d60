"""The python `canopen` library as master of the bench, and Wireshark's dissector as its witness."""

import contextlib
import threading
from pathlib import Path

import canopen
import pytest
from support.built_in_nodes import NODES
from support.dissection import dissect, require_tshark
from support.patience import GUARD

EDS = Path(__file__).parents[1] / "unit" / "canopen_device" / "device.eds"
BENCH = f"""
[plant.axis1]

{NODES}
[nodes.device]
node_id = 5
eds = "{EDS.as_posix()}"

[nodes.unconfigured]
profile = "encoder_406"
node_id = "unconfigured"
serial_number = 77
"""
DATA = bytes(number % 251 for number in range(2000))


@pytest.fixture
def bench(start_bench, tmp_path):
    path = tmp_path / "bench.toml"
    path.write_text(BENCH, encoding="utf-8")
    return start_bench(path)


@pytest.fixture
def network(channel):
    network = canopen.Network()
    network.connect(interface="socketcan", channel=channel)
    yield network
    network.disconnect()


@pytest.fixture
def remote(bench, network):
    assert bench.process.poll() is None
    remote = network.add_node(5, str(EDS))
    remote.sdo.RESPONSE_TIMEOUT = GUARD
    return remote


@pytest.fixture
def record(start, cansend, channel):
    """Record the bus with candump; return a function that ends it and gives the file."""
    candump = start("candump", "-L", "-r", 8 * 1024 * 1024, channel)
    while not candump.output():  # candump does not say when it listens
        cansend("7FF#00")

    def finish(path):
        candump.stop()
        path.write_text(candump.output())
        return path

    return finish


def test_sdo_of_every_kind(record, remote, tmp_path):
    assert remote.sdo[0x1018][4].raw == 0x12345678
    remote.sdo["Text"].raw = "a text of more than one segment"
    assert remote.sdo["Text"].raw == "a text of more than one segment"
    with remote.sdo.open(0x2021, 0, "wb", size=len(DATA), block_transfer=True) as file:
        file.write(DATA)
    with remote.sdo.open(0x2021, 0, "rb", block_transfer=True) as file:
        assert file.read() == DATA
    with pytest.raises(canopen.SdoAbortedError) as aborted:
        remote.sdo[0x1018][1].raw = 1
    assert aborted.value.code == 0x06010002
    expect_sound(record(tmp_path / "sdo.log"))


@contextlib.contextmanager
def boot_up(remote):
    """Wait for the boot-up message that the block causes, however soon it comes."""
    booted = threading.Event()
    remote.nmt.add_heartbeat_callback(lambda state: booted.set() if state == 0 else None)
    yield
    assert booted.wait(GUARD)


def test_nmt_heartbeat_sync_and_emcy(record, remote, network, tmp_path):
    remote.sdo["Producer heartbeat time"].raw = 50
    remote.nmt.state = "OPERATIONAL"
    # Heartbeats from before the command may still be under way.
    while remote.nmt.wait_for_heartbeat(GUARD) != "OPERATIONAL":
        pass

    remote.tpdo.read()
    remote.tpdo[2].trans_type = 1
    remote.tpdo[2].save()
    network.sync.start(0.02)
    with contextlib.ExitStack() as stack:
        stack.callback(network.sync.stop)
        assert all(remote.tpdo[2].wait_for_reception(GUARD) for _ in range(5))

    # A heartbeat that is watched with 100 ms, and comes once.
    remote.sdo["Consumer heartbeat time"][1].raw = 0x77 << 16 | 100
    network.send_message(0x777, b"\x05")
    error = remote.emcy.wait(0x8130, GUARD)
    assert error.code == 0x8130
    assert error.register == 0x11  # generic and communication

    with boot_up(remote):
        remote.nmt.state = "RESET"
    expect_sound(record(tmp_path / "nmt.log"))


@pytest.mark.usefixtures("bench")
def test_lss_fastscan_and_a_new_node_id(record, network, tmp_path):
    # Six bits of the address are 1, and each costs the time-out of a question without answer.
    network.lss.RESPONSE_TIMEOUT = 0.5
    is_found, address = network.lss.fast_scan()
    assert is_found
    assert address == [0, 0x406, 0x10000, 77]
    network.lss.configure_node_id(42)
    remote = network.add_node(42)
    with boot_up(remote):
        network.lss.send_switch_state_global(network.lss.WAITING_STATE)
    remote.sdo.RESPONSE_TIMEOUT = GUARD
    assert remote.sdo.upload(0x1018, 4) == (77).to_bytes(4, "little")
    expect_sound(record(tmp_path / "lss.log"))


@pytest.mark.usefixtures("bench")
def test_conformance_reads_a_device_of_another_process(start, channel, tmp_path):
    report = tmp_path / "report.md"
    bus = "-i", "socketcan", "-c", channel
    device = "--node-id", 5, "--eds", EDS, "--patience", 1
    ended = start("hil-bench", "conformance", *bus, *device, "--report", report).wait(100)
    assert ended.exit_code == 0, ended
    assert " 0 failed" in ended.stderr
    assert "| 7.2.4.3.13 | optional | a block upload brings the same bytes" in report.read_text()


def expect_sound(path):
    """Every frame that the nodes sent is CANopen, and none is malformed."""
    require_tshark()
    rows = dissect(path, "can.id", "frame.protocols", "_ws.malformed", "can.len")
    assert len(rows) > 10
    assert {row[1].split(":")[-1] for row in rows if row[3] != "0"} == {"canopen"}
    assert [row for row in rows if row[2]] == []
