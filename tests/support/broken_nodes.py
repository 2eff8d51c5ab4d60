"""Broken logs of what the bench alone has: nodes with an EDS, and a bench that is not the bus's.

The faults that a log of any stack may have are in `tests/corpus`.
"""

import struct

from support.bus_logs import played
from support.log_cases import Broken, bench_nodes, started
from support.sdo_frames import MS

from device_profiles import ENCODER_406, PRESSURE_404
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.canopen_device.eds import load_eds

BROKEN = Broken()


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


@BROKEN.of(Cause.OTHER_DEVICE, "pressure_x")
def another_device_than_the_eds():
    """Node 2 is a pressure transducer; the EDS at hand is that of an encoder."""
    wrong = KnownNode(2, "pressure_x", load_eds(ENCODER_406, 2))
    return started(), bench_nodes(wrong)


@BROKEN.played(Cause.NOT_STARTED, "valve")
def set_points_before_nmt_start(rig):
    """The master sends set-points and never starts a node."""
    rig.set_up(start=False)
    rig.move(1.5)


@BROKEN.of(Cause.OTHER_BUS)
def log_of_another_bus():
    """The log is of nodes 1 to 4; the bench at hand has 11 to 14."""
    known = [
        KnownNode(node.node_id + 10, node.name, load_eds(PRESSURE_404, node.node_id + 10))
        for node in bench_nodes()
    ]
    begin = started()[-100:]
    return [logged for logged in begin if logged.frame.can_id < 0x580], known
