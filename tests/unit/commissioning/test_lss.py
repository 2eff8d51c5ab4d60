"""Devices without node-ID, found bit by bit (CiA 305)."""

from hil_bench.canopen_device.frame import Frame
from hil_bench.machine.commissioning.lss import LssAddress, find_unconfigured

UNCONFIGURED = """
[plant.axis1]
[nodes.valve]
profile = "valve_408"
node_id = 255
serial_number = 0xFFFFFFFF
[nodes.position]
profile = "encoder_406"
node_id = 255
serial_number = 0x80000001
[nodes.pressure]
profile = "pressure_404"
source = "P_A"
node_id = 5
"""
# Vendor 0, the profile as product code and revision 1.0 are those of the EDS files.
ADDRESSES = {LssAddress(0, 0x408, 0x10000, 0xFFFFFFFF), LssAddress(0, 0x406, 0x10000, 0x80000001)}


def test_all_devices_without_node_id_are_found_and_no_other(open_bench):
    _, network = open_bench(UNCONFIGURED)
    found = find_unconfigured(network)
    assert set(found) == ADDRESSES
    assert len(found) == 2


def test_the_devices_wait_on_as_before(open_bench):
    _, network = open_bench(UNCONFIGURED)
    find_unconfigured(network)
    assert set(find_unconfigured(network)) == ADDRESSES


def test_a_bus_without_such_devices_is_soon_done(open_bench):
    _, network = open_bench()
    begin = network.now()
    assert find_unconfigured(network) == []
    assert network.now() - begin < 0.2


def test_a_device_that_answers_once_and_vanishes_is_not_invented(device, device_network):
    device.answer(0x7E5, "5100000000800000", (0x7E4, "4F00000000000000"))
    assert find_unconfigured(device_network) == []


def test_a_device_that_answers_every_request_is_found_once(make_network, caplog):
    class Parrot:
        """Answers whatever LSS asks, also after it was found."""

        def tick(self, frames, _now):
            identified = Frame(0x7E4, b"\x4f".ljust(8, b"\0"))
            return [identified for frame in frames if frame.can_id == 0x7E5]

    network = make_network(Parrot())
    begin = network.now()
    assert find_unconfigured(network) == [LssAddress(0, 0, 0, 0)]
    assert network.now() - begin < 5.0
    assert "answers LSS on after it was found" in caplog.text
