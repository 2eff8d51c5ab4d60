"""A bench on two SocketCAN interfaces: valve on one, sensors on the other."""

from pathlib import Path

import can
import pytest
from support.patience import GUARD

EXAMPLE = Path(__file__).parents[2] / "examples" / "two_buses.toml"
READ_VENDOR = bytes.fromhex("4018100100000000")  # SDO upload of 0x1018.01


@pytest.fixture
def bench_file(tmp_path, own_channel):
    path = tmp_path / "bench.toml"
    text = EXAMPLE.read_text().replace('"vcan1"', f'"{own_channel}"')
    path.write_text(text)
    return path


def ask(bus, node_id):
    """Return the identifier of the answer to an SDO request; whatever else comes is passed over."""
    request = can.Message(arbitration_id=0x600 + node_id, data=READ_VENDOR, is_extended_id=False)
    bus.send(request)
    while (message := bus.recv(GUARD)) is not None:
        if message.arbitration_id & 0x780 == 0x580:
            return message.arbitration_id
    raise AssertionError(f"node {node_id} does not answer")


def test_each_interface_has_the_nodes_of_its_bus(start, bench_file, channel, own_channel):
    with (
        can.Bus(interface="socketcan", channel=channel) as first,
        can.Bus(interface="socketcan", channel=own_channel) as second,
    ):
        bench = start("hil-bench", "run", bench_file)
        boots = [second.recv(GUARD).arbitration_id for _ in range(3)]
        assert boots == [0x701, 0x702, 0x703]
        assert first.recv(GUARD).arbitration_id == 0x701
        assert ask(first, 1) == ask(second, 1) == 0x581
        assert ask(second, 3) == 0x583
        ended = bench.stop()
    assert ended.exit_code == 130, ended
    assert (
        f"bus    bus: socketcan {channel}\nbus    sensors: socketcan {own_channel}\n"
        in ended.stdout
    )
    assert "          bus: 1 received" in ended.stdout
    assert "          sensors: 2 received" in ended.stdout
