"""Broken logs whose cause is in the messages, where a node has an EDS or RPDOs are watched."""

from support.bus_logs import CYCLE
from support.log_cases import Broken, bench_nodes, started

from device_profiles import PRESSURE_404
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.canopen_device.eds import load_eds

BROKEN = Broken()


@BROKEN.of(Cause.MAPPING, "pressure_x")
def mapped_object_that_the_eds_lacks():
    """The device maps 0x6150.01, which its (older) EDS does not have."""
    objects = load_eds(PRESSURE_404, 2)
    del objects._objects[0x6150]
    return started(), bench_nodes(KnownNode(2, "pressure_x", objects))


@BROKEN.of(Cause.MAPPING, "pressure_a")
def pdo_that_was_remapped_before_the_log_began():
    """A tool gave pressure_a TPDO1 the identifier 0x282; the log begins after that."""
    frames = [
        logged._replace(frame=logged.frame._replace(can_id=0x282))
        if logged.frame.can_id == 0x182
        else logged
        for logged in started()
    ]
    return frames, bench_nodes()


@BROKEN.played(Cause.PDO_LENGTH, "valve")
def controller_that_sends_a_short_pdo(rig):
    """The controller sends two bytes in RPDO1, which maps four: the valve answers by EMCY 8210h."""
    rig.start()
    rig.network.send(0x201, b"\x07\x00")
    rig.move(0.05)


@BROKEN.played(Cause.PDO_MISSING, "pressure_a")
def pdo_that_does_not_follow_every_fourth_sync(rig):
    """Of type 4, it is lost for 20 SYNCs."""
    every_fourth_sync(rig)
    with rig.faults.lose("pressure_a", can_id=0x182):
        rig.move(0.2, sync=CYCLE)


@BROKEN.played(Cause.ABSENT_PRODUCER, "valve")
def consumer_of_a_pdo_that_nobody_sends(rig):
    """RPDO1 of the valve is linked to TPDO1 of node 9, which does not exist."""
    rig.set_up()
    rig.write(rig.valve, 0x1400, 1, 0x80000201)
    rig.write(rig.valve, 0x1400, 1, 0x00000189)
    rig.network.pump(0.5)


@BROKEN.played(Cause.RPDO_TIMEOUT, "valve")
def controller_that_pauses(rig):
    """The controller sends no set-point for 300 ms; the time-out of the valve's RPDO1 is 100 ms."""
    rig.start()
    rig.network.pump(0.3)
    rig.move(0.1)


def every_fourth_sync(rig):
    """Set pressure_a to a TPDO of type 4 and the rest to type 1, and move."""
    rig.set_up(transmission_type=1, event_timer=0.0)
    rig.set_up(rig.pressure_a, transmission_type=4, event_timer=0.0)
    rig.valve.enable()
    rig.move(0.3, sync=CYCLE)
