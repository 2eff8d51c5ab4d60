"""Broken logs whose cause is a node: its identity, its NMT state, its heartbeat."""

import struct

from support.bus_logs import played
from support.log_cases import Broken, bench_nodes, started
from support.sdo_frames import MS

from device_profiles import ENCODER_406, PRESSURE_404
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.canopen_device.eds import load_eds

BROKEN = Broken()


@BROKEN.of(Cause.NO_BOOT_UP, "pressure_b")
def dead_device_that_the_master_speaks_to():
    """The supply of pressure_b is off; the master sets all four up and gives up there."""

    def play(rig):
        rig.faults.silence("pressure_b")
        rig.set_up(rig.valve, rig.pressure_a, rig.position)
        rig.set_up(rig.pressure_b)

    return silenced_from_start("pressure_b", play)


@BROKEN.of(Cause.NO_BOOT_UP, "pressure_b")
def dead_device_that_nobody_speaks_to():
    """The same, and the master does not know of it."""

    def play(rig):
        rig.set_up(rig.valve, rig.pressure_a, rig.position)
        rig.move(0.2)

    return silenced_from_start("pressure_b", play)


def silenced_from_start(name, play):
    node_id = {"pressure_b": 3}[name]
    from_it = {0x080 + node_id, 0x180 + node_id, 0x580 + node_id, 0x700 + node_id}

    def play_without(rig):
        rig.faults.silence(name)
        play(rig)

    frames = played(play_without)
    # What it sent in the tick of its power-on, before the fault could begin.
    return [logged for logged in frames if logged.frame.can_id not in from_it], bench_nodes()


@BROKEN.of(Cause.NODE_ID_CLASH, "pressure_a")
def two_devices_with_one_node_id():
    """A second transducer with node-ID 2 boots, answers and sends 0.3 ms after the first."""
    frames = []
    for logged in started():
        frames.append(logged)
        if logged.frame.can_id in {0x182, 0x582, 0x702}:
            frames.append(logged._replace(now=logged.now + 300_000))
    return frames, bench_nodes()


@BROKEN.of(Cause.NODE_ID_CLASH, "pressure_a")
def two_answers_to_one_request():
    """Two devices have node-ID 2; both were there before the log began, and only answer."""
    frames = []
    for logged in started():
        if logged.frame.can_id != 0x702:
            frames.append(logged)
        if logged.frame.can_id == 0x582:
            frames.append(logged._replace(now=logged.now + 300_000))
    return frames, bench_nodes()


@BROKEN.of(Cause.NODE_ID_CLASH, "node 4")
def two_heartbeats_of_one_node_in_a_log_that_begins_late():
    """The log has no boot-up and no set-up; no EDS is known. Two devices have node-ID 4."""
    late = played(lambda rig: (rig.start(), rig.network.pump(1.5)))[-400:]
    frames = [logged for logged in late if logged.frame.can_id == 0x704]
    first = frames[0].now
    twin = [frame._replace(now=frame.now + 30 * MS) for frame in frames]
    written = KnownNode(4, "", None)
    written.reader(0x1017, 0)
    written.assume(0x1017, 0, struct.pack("<H", 100))
    frames = sorted(frames + twin, key=lambda logged: logged.now)
    return [frame._replace(now=frame.now - first) for frame in frames], [written]


@BROKEN.played(Cause.IDENTIFIER_CLASH, "pressure_b")
def two_nodes_send_one_identifier(rig):
    """A copied configuration: TPDO1 of pressure_b has the identifier of pressure_a's."""
    rig.set_up()
    rig.write(rig.pressure_b, 0x1800, 1, 0x80000183)
    rig.write(rig.pressure_b, 0x1800, 1, 0x40000182)
    rig.move(0.3)


@BROKEN.played(Cause.RESTART, "pressure_a")
def supply_that_breaks_for_a_moment(rig):
    """pressure_a loses its supply for 200 ms in the middle of the motion."""
    rig.start()
    rig.faults.reset("pressure_a", duration=0.2)
    rig.move(0.8)


@BROKEN.of(Cause.OTHER_DEVICE, "pressure_x")
def another_device_than_the_eds():
    """Node 2 is a pressure transducer; the EDS at hand is that of an encoder."""
    wrong = KnownNode(2, "pressure_x", load_eds(ENCODER_406, 2))
    return started(), bench_nodes(wrong)


@BROKEN.played(Cause.NOT_STARTED, "pressure_b")
def node_that_was_forgotten(rig):
    """The master sets all four up and starts three."""
    rig.set_up(rig.valve, rig.pressure_a, rig.position)
    rig.set_up(rig.pressure_b, start=False)
    rig.move(1.5)


@BROKEN.played(Cause.NOT_STARTED, "valve")
def set_points_before_nmt_start(rig):
    """The master sends set-points and never starts a node."""
    rig.set_up(start=False)
    rig.move(1.5)


@BROKEN.played(Cause.START_REFUSED, "pressure_b")
def start_that_does_not_arrive(rig):
    """pressure_b hears nothing when it is started, and says PRE-OPERATIONAL ever after."""
    rig.set_up(start=False)
    with rig.faults.lose("pressure_b", can_id=0x000, direction="received"):
        rig.network.start_node()
        rig.move(0.1)
    rig.move(1.5)


@BROKEN.played(Cause.HEARTBEAT_LOST, "position")
def plug_that_falls_out(rig):
    """The plug of position falls out and stays out; the valve watches its heartbeat."""
    rig.set_up()
    rig.write(rig.valve, 0x1016, 1, 0x0004_00FA)  # node 4, 250 ms
    rig.move(0.5)
    rig.faults.silence("position")
    rig.move(0.8)


@BROKEN.played(Cause.HEARTBEAT_LOST, "position")
def plug_with_a_loose_contact(rig):
    """The same for 0.5 s; then it is back."""
    rig.set_up()
    rig.move(0.5)
    with rig.faults.silence("position"):
        rig.move(0.5)
    rig.move(0.5)


@BROKEN.of(Cause.OTHER_BUS)
def log_of_another_bus():
    """The log is of nodes 1 to 4; the bench at hand has 11 to 14."""
    known = [
        KnownNode(node.node_id + 10, node.name, load_eds(PRESSURE_404, node.node_id + 10))
        for node in bench_nodes()
    ]
    begin = started()[-100:]
    return [logged for logged in begin if logged.frame.can_id < 0x580], known
