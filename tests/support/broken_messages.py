"""Broken logs whose cause is in the messages: SDO, PDO, SYNC, EMCY, load."""

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


@BROKEN.played(Cause.SDO_ABORT, "valve")
def write_to_a_read_only_object(rig):
    """The master writes the status word 0x6041."""
    rig.start()
    rig.write(rig.valve, 0x6041, 0, 1, "H")


@BROKEN.played(Cause.SDO_NO_ANSWER, "pressure_a")
def server_that_is_deaf(rig):
    """SDO requests to pressure_a are lost; its heartbeat and its PDO go on."""
    rig.start()
    with rig.faults.lose("pressure_a", can_id=0x602):
        rig.network.send(0x602, bytes.fromhex("4000100000000000"))
        rig.move(1.5)


@BROKEN.played(Cause.PDO_LENGTH, "valve")
def controller_that_sends_a_short_pdo(rig):
    """The controller sends two bytes in RPDO1, which maps four: the valve answers by EMCY 8210h."""
    rig.start()
    rig.network.send(0x201, b"\x07\x00")
    rig.move(0.05)


@BROKEN.played(Cause.PDO_LENGTH, "position")
def sensor_that_sends_less_than_it_maps(rig):
    """TPDO1 of position has three bytes in place of six."""
    rig.start()
    with rig.faults.truncate("position", 3, can_id=0x184):
        rig.move(0.05)


@BROKEN.played(Cause.PDO_MISSING, "pressure_a")
def pdo_that_stays_out(rig):
    """TPDO1 of pressure_a, due every 10 ms, is lost for 200 ms; its heartbeat is not."""
    rig.start()
    with rig.faults.lose("pressure_a", can_id=0x182):
        rig.move(0.2)
    rig.move(0.1)


@BROKEN.played(Cause.PDO_MISSING, "pressure_a")
def pdo_that_does_not_follow_sync(rig):
    """The same of a TPDO of type 1: SYNC goes on, the TPDO does not."""
    rig.start(transmission_type=1, event_timer=0.0)
    with rig.faults.lose("pressure_a", can_id=0x182):
        rig.move(0.2, sync=CYCLE)


@BROKEN.played(Cause.PDO_MISSING, "pressure_a")
def pdo_that_does_not_follow_every_fourth_sync(rig):
    """Of type 4, it is lost for 20 SYNCs."""
    every_fourth_sync(rig)
    with rig.faults.lose("pressure_a", can_id=0x182):
        rig.move(0.2, sync=CYCLE)


@BROKEN.played(Cause.ABSENT_PRODUCER, "valve")
def heartbeat_consumer_of_nobody(rig):
    """The valve watches node 9, which does not exist."""
    rig.set_up()
    rig.write(rig.valve, 0x1016, 1, 0x0009_00FA)
    rig.move(0.5)


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


@BROKEN.played(Cause.SYNC_MISSING)
def sync_that_stops(rig):
    """The master sends SYNC every 10 ms and stops; set-points and heartbeats go on."""
    rig.start(transmission_type=1, event_timer=0.0)
    rig.move(1.2)  # set-points go on: a controller that ends is silent


@BROKEN.played(Cause.SYNC_MISSING)
def sync_with_gaps(rig):
    """Every tenth SYNC is missing; set-points go on."""
    rig.start(transmission_type=1, event_timer=0.0)
    for _ in range(5):
        rig.move(0.09, sync=CYCLE)
        rig.move(CYCLE)


@BROKEN.played(Cause.SYNC_JITTER)
def sync_of_a_loaded_pc(rig):
    """SYNC comes after 7 and 13 ms in turn."""
    rig.start(transmission_type=1, event_timer=0.0)
    for _ in range(30):
        rig.move(0.001, sync=0.007)
        rig.move(0.001, sync=0.013)


@BROKEN.played(Cause.EMCY, "pressure_a")
def transducer_beyond_its_span(rig):
    """pressure_a measures 400 bar more than there is: F001h, and gone again at the end."""
    rig.start()
    with rig.faults.offset("pressure_a", 400e5):
        rig.move(0.1)
    rig.move(0.1)


@BROKEN.played(Cause.BUS_LOAD)
def node_that_babbles(rig):
    """A node floods the bus with eight frames a millisecond: 50 bits each are 40 % of 1 Mbit/s,
    which is too much for 250 kbit/s."""
    rig.start()
    with rig.faults.babble("pressure_b", 8, can_id=0x7FF):
        rig.move(0.5)


def every_fourth_sync(rig):
    """Set pressure_a to a TPDO of type 4 and the rest to type 1, and move."""
    rig.set_up(transmission_type=1, event_timer=0.0)
    rig.set_up(rig.pressure_a, transmission_type=4, event_timer=0.0)
    rig.valve.enable()
    rig.move(0.3, sync=CYCLE)
