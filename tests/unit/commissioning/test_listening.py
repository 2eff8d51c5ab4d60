"""What is heard on a bus."""

import can
import pytest

from hil_bench.abilities.commissioning.discovery import BusTraffic, listen, signs_of_operation


def message(can_id, data="", **kind):
    return can.Message(
        arbitration_id=can_id, data=bytes.fromhex(data), is_extended_id=False, **kind
    )


def test_nothing_is_sent(device, device_network):
    listen(device_network, 0.5)
    assert device.received == []


def test_frames_are_counted_by_identifier(open_bench):
    _, network = open_bench()
    network.start_node()
    traffic = listen(network, 0.1)
    # The bench's encoder sends its TPDO each 10 ms, by its EDS.
    position = traffic.identifiers[0x184, False]
    assert position.frames == 10
    assert (position.function, position.node_id) == ("TPDO1", 4)
    assert traffic.duration == pytest.approx(0.1)


def test_a_29_bit_identifier_is_another_and_no_canopen():
    traffic = BusTraffic()
    traffic.take(message(0x181))
    traffic.take(can.Message(arbitration_id=0x181, is_extended_id=True))
    assert traffic.frames == 2
    assert traffic.identifiers[0x181, True].function == "not CANopen"
    assert traffic.identifiers[0x181, True].node_id is None


def test_error_frames_are_no_frames():
    traffic = BusTraffic()
    traffic.take(can.Message(is_error_frame=True))
    assert (traffic.frames, traffic.error_frames) == (0, 1)


def test_the_load_is_the_share_of_the_bus_time():
    traffic = BusTraffic(duration=1.0)
    for _ in range(1000):
        traffic.take(message(0x181, "0001020304050607"))
    # 1000 frames of 111 to 135 bits in a second at 500 kbit/s.
    assert 0.222 <= traffic.load(500_000) <= 0.270
    traffic.duration = 0.0
    assert traffic.load(500_000) == 0.0  # nothing was seen in no time


def test_a_remote_frame_is_said_to_be_one():
    traffic = BusTraffic()
    traffic.take(message(0x701, is_remote_frame=True))
    assert traffic.identifiers[0x701, False].meaning == "remote frame"


def test_frames_of_can_fd_are_counted_and_are_nobodys():
    traffic = BusTraffic(1.0)
    fd = can.Message(arbitration_id=0x701, is_extended_id=False, is_fd=True, data=bytes(64))
    traffic.take(fd)
    traffic.take(can.Message(arbitration_id=0x702, is_extended_id=False, data=b"\x7f"))
    assert (traffic.frames, traffic.fd_frames) == (2, 1)
    assert [row.node_id for row in traffic.identifiers.values()] == [2]
    assert traffic.bits > 67 + 8 * 64  # linux/can/length.h: the bits without stuff bits
    assert signs_of_operation(traffic) == ("CAN FD",)
