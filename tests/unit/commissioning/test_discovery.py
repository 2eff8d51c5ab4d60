"""Who is on the bus. Identifiers and messages are those of CiA 301."""

import can
import pytest

from hil_bench.abilities.commissioning.discovery import (
    BusTraffic,
    Method,
    Sighting,
    discover,
    listen,
    signs_of_operation,
)
from hil_bench.errors import ConfigError
from hil_drivers import NmtState

READ_DEVICE_TYPE = "4000100000000000"


@pytest.mark.parametrize("method", [Method.SDO, Method.GUARDING, Method.BOOT_UP])
def test_every_node_of_the_bench_is_found(open_bench, method):
    _, network = open_bench()
    assert [seen.node_id for seen in discover(network, method)] == [1, 2, 3, 4]


def test_a_node_that_sends_heartbeats_is_found_without_a_frame_from_us(open_bench):
    bench, network = open_bench(
        '[plant.axis1]\n[nodes.valve]\nprofile = "valve_408"\nnode_id = 9\n'
        'objects = { "0x1017" = 100 }\n'
    )
    bench.frames.clear()
    assert discover(network, Method.HEARTBEAT) == [Sighting(9, NmtState.PRE_OPERATIONAL, 0)]
    assert not [logged for logged in bench.frames if logged.is_received]


def test_a_scan_by_sdo_changes_no_state(open_bench):
    _, network = open_bench()
    network.start_node()
    network.pump(0.01)
    discover(network, Method.SDO)
    states = {seen.nmt_state for seen in discover(network, Method.GUARDING)}
    assert states == {NmtState.OPERATIONAL}


def test_only_the_wanted_nodes_are_asked(device, device_network):
    discover(device_network, Method.SDO, node_ids=[5, 3])
    assert [frame.can_id for frame in device.received] == [0x603, 0x605]


def test_a_refusal_is_a_sign_of_life(device, device_network):
    device.answer(0x60A, READ_DEVICE_TYPE, (0x58A, "8000100000000206"))  # object does not exist
    assert discover(device_network, Method.SDO) == [Sighting(10, None, 1)]


def test_two_answers_are_two_devices(device, device_network):
    device.answer(0x60A, READ_DEVICE_TYPE, (0x58A, "4300100098010000"), (0x58A, "4300100094010200"))
    assert discover(device_network, Method.SDO) == [Sighting(10, None, 2)]


@pytest.mark.parametrize(
    ("can_id", "data"),
    [
        (0x58A, "43001000980100"),  # 7 bytes
        (0x58A, "4301100098010000"),  # another object
        (0x70A, "33"),  # no NMT state
        (0x70A, "0500"),  # 2 bytes
    ],
)
def test_garbage_is_no_node(device, device_network, can_id, data):
    device.answer(0x60A, READ_DEVICE_TYPE, (can_id, data))
    assert discover(device_network, Method.SDO) == []


def test_the_toggle_bit_of_node_guarding_is_no_part_of_the_state(device, device_network):
    device.answer(0x70A, "", (0x70A, "85"))
    assert discover(device_network, Method.GUARDING) == [Sighting(10, NmtState.OPERATIONAL, 0)]


@pytest.mark.parametrize("node_id", [0, 128, -1])
def test_a_node_id_that_is_none_is_refused(device_network, node_id):
    with pytest.raises(ConfigError, match="1 to 127 is right"):
        discover(device_network, Method.SDO, node_ids=[node_id])


@pytest.mark.parametrize("patience", [0.0, -1.0, float("inf"), float("nan")])
def test_a_patience_that_makes_no_sense_is_refused(device_network, patience):
    with pytest.raises(ConfigError, match="positive time"):
        discover(device_network, Method.SDO, patience=patience)


# What is heard on a bus.


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
