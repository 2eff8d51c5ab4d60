"""Whatever takes the controller away, the spool goes to its centre and the piston stands.

The spool's closed loop has 1200 rad/s and damping 0.7 (Table I), so 99.9 % of a step is over after
ln(1000) / (0.7 * 1200) = 8.2 ms; 15 ms after the hold value was commanded it is at its centre.
"""

import struct

import pytest
from support.bus_side import CONTROLLER, VALVE

from hil_bench.canopen_device.frame import Frame

HALF_OPEN = 8192  # 50 %
SETTLED = 15  # ticks of 1 ms
FULL_OPENING = 1.3e-3  # alpha + beta of Table I [m]


def drive(bus):
    bus.activate()
    bus.command(0x0007, HALF_OPEN, count=20)
    assert bus.plant.output.nu == pytest.approx(0.5 * FULL_OPENING, rel=1e-3)


def assert_centred(bus):
    assert abs(bus.plant.output.nu) < 1e-3 * FULL_OPENING
    assert bus.plant.output.z == 0.0


def status_word(bus):
    return next(
        struct.unpack_from("<H", frame.data)[0]
        for frame in reversed(bus.log)
        if frame.can_id == 0x180 + VALVE
    )


def test_the_spool_follows_the_bus_only_while_active(bus):
    bus.tick()
    bus.nmt(0x01)
    bus.command(0x0000, HALF_OPEN, count=20)
    assert_centred(bus)
    bus.command(0x0003, HALF_OPEN, count=20)  # HOLD
    assert_centred(bus)
    bus.command(0x0007, HALF_OPEN, count=20)  # ACTIVE
    assert bus.plant.output.nu == pytest.approx(0.5 * FULL_OPENING, rel=1e-3)


def test_an_rpdo_time_out_centres_the_spool(bus):
    bus.tick()
    assert bus.download(VALVE, 0x1400, 5, struct.pack("<H", 50))[0] == 0x60
    drive(bus)
    sent = bus.tick(count=49)  # the RPDO is due within 50 ms of the last one
    assert not [frame for frame in sent if frame.can_id == 0x080 + VALVE]
    sent = bus.tick(count=2)
    emergency = next(frame for frame in sent if frame.can_id == 0x080 + VALVE)
    assert struct.unpack_from("<H", emergency.data)[0] == 0x8250
    bus.tick(count=SETTLED)
    assert_centred(bus)
    assert status_word(bus) & 0x0F == 0x03  # FAULT_HOLD, R M H D = 0011


def test_a_lost_heartbeat_centres_the_spool(bus):
    bus.tick()
    watch = CONTROLLER << 16 | 30
    assert bus.download(VALVE, 0x1016, 1, struct.pack("<I", watch))[0] == 0x60
    bus.tick(Frame(0x700 + CONTROLLER, b"\x05"))
    drive(bus)  # takes 20 ms of the 30
    bus.command(0x0007, HALF_OPEN, count=30)
    emergency = next(frame for frame in bus.log if frame.can_id == 0x080 + VALVE)
    assert struct.unpack_from("<H", emergency.data)[0] == 0x8130
    bus.tick(count=SETTLED)
    assert_centred(bus)


@pytest.mark.parametrize("command", [0x02, 0x80, 0x81, 0x82], ids=hex)
def test_leaving_operational_centres_the_spool_for_good(bus, command):
    drive(bus)
    bus.nmt(command)
    bus.tick(count=SETTLED)
    assert_centred(bus)
    bus.nmt(0x01)
    bus.tick(count=SETTLED)  # the control word of before does not bring ACTIVE back
    assert_centred(bus)
    bus.command(0x0007, HALF_OPEN, count=SETTLED)
    assert bus.plant.output.nu == pytest.approx(0.5 * FULL_OPENING, rel=1e-3)


def test_a_hold_value_other_than_centre_is_obeyed(bus):
    bus.tick()
    assert bus.download(VALVE, 0x6314, 1, struct.pack("<h", -4096))[0] == 0x60
    drive(bus)
    bus.command(0x0003, HALF_OPEN, count=20)
    assert bus.plant.output.nu == pytest.approx(-0.25 * FULL_OPENING, rel=1e-3)
