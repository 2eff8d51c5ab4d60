"""Devices without node-ID, found bit by bit (CiA 305)."""

import struct

import pytest

from hil_bench.abilities.commissioning.survey import LssAddress, LssScan, find_unconfigured
from hil_bench.canopen_device.frame import Frame

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
    found = find_unconfigured(network).devices
    assert set(found) == ADDRESSES
    assert len(found) == 2


def test_the_devices_wait_on_as_before(open_bench):
    _, network = open_bench(UNCONFIGURED)
    find_unconfigured(network)
    assert set(find_unconfigured(network).devices) == ADDRESSES


def test_a_bus_without_such_devices_is_soon_done(open_bench):
    _, network = open_bench()
    begin = network.now()
    assert find_unconfigured(network) == LssScan(())
    assert network.now() - begin < 0.2


def test_a_device_that_answers_once_and_vanishes_is_not_invented(device, device_network):
    device.answer(0x7E5, "5100000000800000", (0x7E4, "4F00000000000000"))
    devices, problem = find_unconfigured(device_network)
    assert devices == ()
    assert "answered, but not to all steps" in problem


class Parrot:
    """Answers whatever LSS asks, also after it was found."""

    def tick(self, frames, _now):
        identified = Frame(0x7E4, b"\x4f".ljust(8, b"\0"))
        return [identified for frame in frames if frame.can_id == 0x7E5]


def test_a_device_that_answers_every_request_has_no_address(make_network):
    network = make_network(Parrot())
    begin = network.now()
    devices, problem = find_unconfigured(network)
    assert devices == ()
    assert "answers each step, so that its address is not known" in problem
    assert network.now() - begin < 5.0


class Slow:
    """An LSS slave with one address, after CiA 305, that takes some ticks for each answer."""

    def __init__(self, address, *delays):
        self._address, self._delays = address, iter(delays)
        self._delay, self._due, self._part, self._is_waiting = 0, [], 0, True

    def tick(self, frames, now):
        for frame in frames:
            if frame.can_id == 0x7E5:
                self._take(frame.data, now)
        count = len([due for due in self._due if due <= now])
        del self._due[:count]
        return [Frame(0x7E4, b"\x4f".ljust(8, b"\0"))] * count

    def _take(self, data, now):
        number, bit, part, following = struct.unpack_from("<IBBB", data, 1)
        if data[0] == 0x04:
            self._is_waiting = data[1] == 0
        if data[0] != 0x51 or not self._is_waiting:
            return
        if bit == 0x80:
            self._part = 0
        elif part != self._part or (self._address[part] ^ number) >> bit:
            return
        elif following != part:
            self._part, self._is_waiting = following, bool(following)
        self._delay = next(self._delays, self._delay)
        self._due.append(now + self._delay * 1_000_000)


SERIAL = LssAddress(1, 2, 0x10003, 0x80000004)


@pytest.mark.parametrize("delays", [(60,), (300,), (5, 60)])
def test_a_slow_device_is_found_with_patience(make_network, delays):
    """Delays [ms]: from the first answer on, and from the second where two are given."""
    network = make_network(Slow(SERIAL, *delays))
    assert find_unconfigured(network, 0.5) == LssScan((SERIAL,))


def test_a_device_that_is_slower_than_the_patience_is_said(make_network):
    devices, problem = find_unconfigured(make_network(Slow(SERIAL, 60)), 0.05)
    assert devices == ()
    assert "later than the patience of 50 ms" in problem


class Several:
    """Devices on one bus."""

    def __init__(self, *devices):
        self._devices = devices

    def tick(self, frames, now):
        return [frame for device in self._devices for frame in device.tick(frames, now)]


class Unimpressed(Slow):
    """Answers with its own address, and again once it was found."""

    def _take(self, data, now):
        self._is_waiting = True
        super()._take(data, now)


def test_two_devices_of_one_serial_number_are_not_one(make_network):
    devices, problem = find_unconfigured(make_network(Several(Slow(SERIAL), Slow(SERIAL))))
    assert devices == (SERIAL,)
    assert problem == (
        "2 devices without node-ID answer to serial number 0x80000004 of one product: connect one "
        "at a time"
    )


def test_a_device_that_answers_on_hides_others(make_network):
    found = find_unconfigured(make_network(Several(Unimpressed(SERIAL), Slow((*SERIAL[:3], 9)))))
    assert SERIAL in found.devices
    assert "answers on after it was found, which hides others" in found.problem


def test_a_device_without_any_identity_has_the_address_of_zeros(make_network):
    assert find_unconfigured(make_network(Slow((0, 0, 0, 0)))) == LssScan((LssAddress(0, 0, 0, 0),))
