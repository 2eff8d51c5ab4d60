"""Who is on the bus. Identifiers and messages are those of CiA 301."""

import pytest

from hil_bench.abilities.commissioning.discovery import Method, Sighting, discover
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
