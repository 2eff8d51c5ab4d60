"""CAN FD on real SocketCAN: what can-utils send is recorded, replayed, and unheard by devices."""

import subprocess

import can
import pytest
from support.can_link import set_link
from support.patience import GUARD

from hil_bench.abilities.recording.frames import read_frames
from hil_bench.canopen_device.frame import BRS, ESI, FDF, Frame

LONG = bytes(range(64))
SENT = [f"123##1{LONG.hex().upper()}", "1ABCDEF0##2.11.22.33", "181##0", "301#0102"]
HEARD = [
    Frame(0x123, LONG, fd=FDF | BRS),
    Frame(0x1ABCDEF0, bytes.fromhex("112233"), is_extended=True, fd=FDF | ESI),
    Frame(0x181, fd=FDF),
    Frame(0x301, b"\x01\x02"),
]


@pytest.fixture
def make_interface():
    """Make an interface with a largest frame: 16 for classical CAN, 72 for CAN FD (linux/can.h)."""
    made = []

    def make(mtu):
        name = f"vcan_mtu{mtu}"
        added = subprocess.run(["ip", "link", "add", name, "type", "vcan"], check=False)
        if added.returncode:
            pytest.skip("no right to add an interface; tests/socketcan/with_vcan.py gives it")
        made.append(name)
        subprocess.run(["ip", "link", "set", name, "mtu", str(mtu)], check=True)
        set_link(name, "up")
        return name

    yield make
    for name in made:
        subprocess.run(["ip", "link", "del", name], check=True)


def send(channel):
    for frame in SENT:
        subprocess.run(["cansend", channel, frame], check=True)


def test_what_cansend_sends_is_recorded_shown_and_replayed(make_interface, start, tmp_path):
    channel = make_interface(72)
    path = tmp_path / "own.log"
    record = start("hil-bench", "record", "-i", "socketcan", "-c", channel, path)
    monitor = start("hil-bench", "monitor", "-i", "socketcan", "-c", channel, "--json")
    with can.Bus(interface="socketcan", channel=channel, fd=True) as bus:

        def wait_for(log, text):
            """Send what is of no interest until the log and the monitor have got so far."""
            while not (path.exists() and log in path.read_text() and text in monitor.output()):
                bus.send(can.Message(arbitration_id=0x7FF, is_extended_id=False))
                bus.recv(0.1)

        wait_for("7FF#", '"id": 2047')
        send(channel)
        wait_for("301#0102", '"data": "0102"')
    assert monitor.output().count('"is_fd": true') == 3
    monitor.stop()
    assert record.stop().exit_code == 0
    recorded = [logged.frame for logged in read_frames(path) if logged.frame.can_id != 0x7FF]
    assert recorded == HEARD
    with can.Bus(interface="socketcan", channel=channel, fd=True) as bus:
        replay = start("hil-bench", "replay", path, "-i", "socketcan", "-c", channel, "--fd")
        heard = []
        while len(heard) < len(HEARD):
            message = bus.recv(GUARD)
            if message.arbitration_id != 0x7FF:
                heard.append((message.arbitration_id, bytes(message.data), message.is_fd))
        assert heard == [(f.can_id, f.data, f.fd != 0) for f in HEARD]
        assert replay.wait().exit_code == 0


def test_a_bench_records_can_fd_and_its_devices_go_on(make_interface, start, tmp_path):
    channel = make_interface(72)
    path = tmp_path / "run.mf4"
    words = ["-i", "socketcan", "-c", channel, "--fd", "--record", path, "--whole-bus"]
    with can.Bus(interface="socketcan", channel=channel, fd=True) as bus:
        bench = start("hil-bench", "run", *words)
        boots = set()
        while len(boots) < 4:
            boots.add(bus.recv(GUARD).arbitration_id)
        send(channel)
        subprocess.run(["cansend", channel, "601##04000100000000000"], check=True)
        subprocess.run(["cansend", channel, "602#4000100000000000"], check=True)
        answers = set()
        while 0x582 not in answers:  # of node 2, asked after node 1 by a classical frame
            answers.add(bus.recv(GUARD).arbitration_id)
        assert 0x581 not in answers
    ended = bench.stop()
    assert "the same identifiers" not in ended.stderr  # as TPDO1 of the valve, by CAN FD
    received = [logged.frame for logged in read_frames(path) if logged.is_received]
    assert [frame for frame in received if frame.can_id not in {0x601, 0x602}] == HEARD


def test_an_interface_of_classical_can_is_refused_in_a_line(make_interface, start):
    channel = make_interface(16)
    ended = start("hil-bench", "run", "-i", "socketcan", "-c", channel, "--fd").wait()
    assert ended.exit_code == 3
    (line,) = ended.stderr.splitlines()
    assert f"socketcan {channel}: the interface is set to classical CAN" in line
