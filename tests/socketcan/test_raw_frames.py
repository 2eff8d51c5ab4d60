"""Frames sent by hand with can-utils are enough to command the valve and to move the piston."""

import struct

NMT_START_ALL = "000#0100"
VALVE_STATUS = 0x181  # TPDO 1 of node 1: status word 0x6041, actual value 0x6301.01
POSITION = 0x184  # TPDO 1 of node 4: position 0x6004 in steps of 1 µm, speed 0x6030.01
ACTIVE = 0x000F  # status word of CiA 408: ready, device mode active, hold, disabled
STEPS_PER_MM = 1000


def position(message):
    return struct.unpack_from("<i", message.data)[0]


def test_cansend_enables_the_valve_and_moves_the_piston(start_bench, watch, cansend):
    start_bench()
    cansend(NMT_START_ALL)
    begin = position(watch.wait_for(POSITION))

    cansend("201#07000020")  # control word 0x0007, set-point 0x2000 = 50 %
    watch.wait_for(VALVE_STATUS, lambda data: data[0] == ACTIVE)
    is_beyond = begin + 20 * STEPS_PER_MM
    moved = watch.wait_for(POSITION, lambda data: struct.unpack_from("<i", data)[0] > is_beyond)

    cansend("201#07000000")  # spool to its centre, where the overlap closes the orifices
    centred = watch.wait_for(VALVE_STATUS, lambda data: struct.unpack_from("<h", data, 2)[0] == 0)
    stopped = watch.wait_for(POSITION, lambda data: struct.unpack_from("<h", data, 4)[0] == 0)
    # No faster than 0.102 m/s, its speed at 50 % without friction, until the valve was closed, and
    # 10 mm for what the frames' times and the closing valve leave open.
    way = round(110 * STEPS_PER_MM * (centred.timestamp - moved.timestamp)) + 10 * STEPS_PER_MM
    assert position(moved) <= position(stopped) < position(moved) + way


def test_a_set_point_without_enabling_leaves_the_spool_at_its_centre(start_bench, watch, cansend):
    start_bench()
    cansend(NMT_START_ALL)
    cansend("201#00000020")  # control word 0, set-point 50 %
    cansend("601#4000630100000000")  # the set-point has arrived once the SDO server answers so
    answer = watch.wait_for(0x581)
    assert bytes(answer.data) == bytes.fromhex("4B00630100200000")
    statuses = [watch.wait_for(VALVE_STATUS) for _ in range(20)]
    # Status 1000 (ready, not disabled: INIT) and a spool at rest, in each of them.
    assert {bytes(status.data) for status in statuses} == {b"\x08\x00\x00\x00"}
