"""`explain` on broken logs of known cause, and on sound ones.

Each log is made by the bench: its description is the function's docstring. The cause is what the
function does, so nothing here is taken from what `explain` says.
"""

import functools
import struct
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.bus_logs import CYCLE, played
from support.sdo_frames import MS, download, heard

from device_profiles import ENCODER_406, PRESSURE_404
from hil_bench.bench.configuration import load_config
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import Frame
from hil_bench.eyes.explain.explain import explain
from hil_bench.eyes.explain.finding import Cause
from hil_bench.eyes.known_node import KnownNode
from hil_bench.eyes.nodes import merge_nodes, nodes_of
from hil_bench.outside.recording.logged_frame import LoggedFrame

BITRATE = 1_000_000


def bench_nodes(*others):
    return merge_nodes(nodes_of(load_config()), others)


@functools.cache
def started():
    """A sound motion, which several logs begin with."""
    return tuple(played(lambda rig: rig.start()))


@dataclass
class Case:
    make: object
    cause: Cause
    node: str


BROKEN = {}
SOUND = {}


def broken(cause, node=""):
    def register(make):
        BROKEN[make.__name__] = Case(make, cause, node)
        return make

    return register


def sound(make):
    SOUND[make.__name__] = make
    return make


@broken(Cause.NO_BOOT_UP, "pressure_b")
def dead_device_that_the_master_speaks_to():
    """The supply of pressure_b is off; the master sets all four up and gives up there."""

    def play(rig):
        rig.faults.silence("pressure_b")
        rig.set_up(rig.valve, rig.pressure_a, rig.position)
        rig.set_up(rig.pressure_b)

    return silenced_from_start("pressure_b", play)


@broken(Cause.NO_BOOT_UP, "pressure_b")
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


@broken(Cause.NODE_ID_CLASH, "pressure_a")
def two_devices_with_one_node_id():
    """A second transducer with node-ID 2 boots, answers and sends 0.3 ms after the first."""
    frames = []
    for logged in started():
        frames.append(logged)
        if logged.frame.can_id in {0x182, 0x582, 0x702}:
            frames.append(logged._replace(now=logged.now + 300_000))
    return frames, bench_nodes()


@broken(Cause.NODE_ID_CLASH, "pressure_a")
def two_answers_to_one_request():
    """Two devices have node-ID 2; both were there before the log began, and only answer."""
    frames = []
    for logged in started():
        if logged.frame.can_id != 0x702:
            frames.append(logged)
        if logged.frame.can_id == 0x582:
            frames.append(logged._replace(now=logged.now + 300_000))
    return frames, bench_nodes()


@broken(Cause.NODE_ID_CLASH, "node 4")
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


@broken(Cause.IDENTIFIER_CLASH, "pressure_b")
def two_nodes_send_one_identifier():
    """A copied configuration: TPDO1 of pressure_b has the identifier of pressure_a's."""

    def play(rig):
        rig.set_up()
        rig.write(rig.pressure_b, 0x1800, 1, 0x80000183)
        rig.write(rig.pressure_b, 0x1800, 1, 0x40000182)
        rig.move(0.3)

    return played(play), bench_nodes()


@broken(Cause.RESTART, "pressure_a")
def supply_that_breaks_for_a_moment():
    """pressure_a loses its supply for 200 ms in the middle of the motion."""

    def play(rig):
        rig.start()
        rig.faults.reset("pressure_a", duration=0.2)
        rig.move(0.8)

    return played(play), bench_nodes()


@broken(Cause.OTHER_DEVICE, "pressure_x")
def another_device_than_the_eds():
    """Node 2 is a pressure transducer; the EDS at hand is that of an encoder."""
    wrong = KnownNode(2, "pressure_x", load_eds(ENCODER_406, 2))
    return started(), bench_nodes(wrong)


@broken(Cause.MAPPING, "pressure_x")
def mapped_object_that_the_eds_lacks():
    """The device maps 0x6150.01, which its (older) EDS does not have."""
    objects = load_eds(PRESSURE_404, 2)
    del objects._objects[0x6150]
    return started(), bench_nodes(KnownNode(2, "pressure_x", objects))


@broken(Cause.MAPPING, "pressure_a")
def pdo_that_was_remapped_before_the_log_began():
    """A tool gave pressure_a TPDO1 the identifier 0x282; the log begins after that."""
    frames = [
        logged._replace(frame=logged.frame._replace(can_id=0x282))
        if logged.frame.can_id == 0x182
        else logged
        for logged in started()
    ]
    return frames, bench_nodes()


@broken(Cause.NOT_STARTED, "pressure_b")
def node_that_was_forgotten():
    """The master sets all four up and starts three."""

    def play(rig):
        rig.set_up(rig.valve, rig.pressure_a, rig.position)
        rig.set_up(rig.pressure_b, start=False)
        rig.move(1.5)

    return played(play), bench_nodes()


@broken(Cause.NOT_STARTED, "valve")
def set_points_before_nmt_start():
    """The master sends set-points and never starts a node."""

    def play(rig):
        rig.set_up(start=False)
        rig.move(1.5)

    return played(play), bench_nodes()


@broken(Cause.START_REFUSED, "pressure_b")
def start_that_does_not_arrive():
    """pressure_b hears nothing when it is started, and says PRE-OPERATIONAL ever after."""

    def play(rig):
        rig.set_up(start=False)
        with rig.faults.lose("pressure_b", can_id=0x000, direction="received"):
            rig.network.start_node()
            rig.move(0.1)
        rig.move(1.5)

    return played(play), bench_nodes()


@broken(Cause.HEARTBEAT_LOST, "position")
def plug_that_falls_out():
    """The plug of position falls out and stays out; the valve watches its heartbeat."""

    def play(rig):
        rig.set_up()
        rig.write(rig.valve, 0x1016, 1, 0x0004_00FA)  # node 4, 250 ms
        rig.move(0.5)
        rig.faults.silence("position")
        rig.move(0.8)

    return played(play), bench_nodes()


@broken(Cause.HEARTBEAT_LOST, "position")
def plug_with_a_loose_contact():
    """The same for 0.5 s; then it is back."""

    def play(rig):
        rig.set_up()
        rig.move(0.5)
        with rig.faults.silence("position"):
            rig.move(0.5)
        rig.move(0.5)

    return played(play), bench_nodes()


@broken(Cause.SDO_ABORT, "valve")
def write_to_a_read_only_object():
    """The master writes the status word 0x6041."""

    def play(rig):
        rig.start()
        rig.write(rig.valve, 0x6041, 0, 1, "H")

    return played(play), bench_nodes()


@broken(Cause.SDO_NO_ANSWER, "pressure_a")
def server_that_is_deaf():
    """SDO requests to pressure_a are lost; its heartbeat and its PDO go on."""

    def play(rig):
        rig.start()
        with rig.faults.lose("pressure_a", can_id=0x602):
            rig.network.send(0x602, bytes.fromhex("4000100000000000"))
            rig.move(1.5)

    return played(play), bench_nodes()


@broken(Cause.PDO_LENGTH, "valve")
def controller_that_sends_a_short_pdo():
    """The controller sends two bytes in RPDO1, which maps four: the valve answers by EMCY 8210h."""

    def play(rig):
        rig.start()
        rig.network.send(0x201, b"\x07\x00")
        rig.move(0.05)

    return played(play), bench_nodes()


@broken(Cause.PDO_LENGTH, "position")
def sensor_that_sends_less_than_it_maps():
    """TPDO1 of position has three bytes in place of six."""

    def play(rig):
        rig.start()
        with rig.faults.truncate("position", 3, can_id=0x184):
            rig.move(0.05)

    return played(play), bench_nodes()


@broken(Cause.PDO_MISSING, "pressure_a")
def pdo_that_stays_out():
    """TPDO1 of pressure_a, due every 10 ms, is lost for 200 ms; its heartbeat is not."""

    def play(rig):
        rig.start()
        with rig.faults.lose("pressure_a", can_id=0x182):
            rig.move(0.2)
        rig.move(0.1)

    return played(play), bench_nodes()


@broken(Cause.PDO_MISSING, "pressure_a")
def pdo_that_does_not_follow_sync():
    """The same of a TPDO of type 1: SYNC goes on, the TPDO does not."""

    def play(rig):
        rig.start(transmission_type=1, event_timer=0.0)
        with rig.faults.lose("pressure_a", can_id=0x182):
            rig.move(0.2, sync=CYCLE)

    return played(play), bench_nodes()


@broken(Cause.ABSENT_PRODUCER, "valve")
def heartbeat_consumer_of_nobody():
    """The valve watches node 9, which does not exist."""

    def play(rig):
        rig.set_up()
        rig.write(rig.valve, 0x1016, 1, 0x0009_00FA)
        rig.move(0.5)

    return played(play), bench_nodes()


@broken(Cause.ABSENT_PRODUCER, "valve")
def consumer_of_a_pdo_that_nobody_sends():
    """RPDO1 of the valve is linked to TPDO1 of node 9, which does not exist."""

    def play(rig):
        rig.set_up()
        rig.write(rig.valve, 0x1400, 1, 0x80000201)
        rig.write(rig.valve, 0x1400, 1, 0x00000189)
        rig.network.pump(0.5)

    return played(play), bench_nodes()


@broken(Cause.RPDO_TIMEOUT, "valve")
def controller_that_pauses():
    """The controller sends no set-point for 300 ms; the time-out of the valve's RPDO1 is 100 ms."""

    def play(rig):
        rig.start()
        rig.network.pump(0.3)
        rig.move(0.1)

    return played(play), bench_nodes()


@broken(Cause.SYNC_MISSING)
def sync_that_stops():
    """The master sends SYNC every 10 ms and stops; heartbeats go on."""

    def play(rig):
        rig.start(transmission_type=1, event_timer=0.0)
        rig.network.pump(0.09)  # less than the time-out of RPDO1

    return played(play), bench_nodes()


@broken(Cause.SYNC_MISSING)
def sync_with_gaps():
    """Every tenth SYNC is missing; set-points go on."""

    def play(rig):
        rig.start(transmission_type=1, event_timer=0.0)
        for _ in range(5):
            rig.move(0.09, sync=CYCLE)
            rig.move(CYCLE)

    return played(play), bench_nodes()


@broken(Cause.SYNC_JITTER)
def sync_of_a_loaded_pc():
    """SYNC comes after 7 and 13 ms in turn."""

    def play(rig):
        rig.start(transmission_type=1, event_timer=0.0)
        for _ in range(30):
            rig.move(0.001, sync=0.007)
            rig.move(0.001, sync=0.013)

    return played(play), bench_nodes()


@broken(Cause.EMCY, "pressure_a")
def transducer_beyond_its_span():
    """pressure_a measures 400 bar more than there is: F001h, and gone again at the end."""

    def play(rig):
        rig.start()
        with rig.faults.offset("pressure_a", 400e5):
            rig.move(0.1)
        rig.move(0.1)

    return played(play), bench_nodes()


@broken(Cause.BUS_LOAD)
def node_that_babbles():
    """A node floods the bus with eight frames a millisecond: 50 bits each are 40 % of 1 Mbit/s,
    which is too much for 250 kbit/s."""

    def play(rig):
        rig.start()
        with rig.faults.babble("pressure_b", 8, can_id=0x7FF):
            rig.move(0.5)

    return played(play), bench_nodes()


@broken(Cause.OTHER_BUS)
def log_of_another_bus():
    """The log is of nodes 1 to 4; the bench at hand has 11 to 14."""
    known = [
        KnownNode(node.node_id + 10, node.name, load_eds(PRESSURE_404, node.node_id + 10))
        for node in bench_nodes()
    ]
    begin = started()[-100:]
    return [logged for logged in begin if logged.frame.can_id < 0x580], known


@sound
def motion_with_pdos_on_event():
    """The master sets all up, starts them and moves the axis."""
    return started(), bench_nodes()


@sound
def motion_with_sync():
    """The same with SYNC every 10 ms and TPDOs of type 1."""
    return played(lambda rig: rig.start(transmission_type=1, event_timer=0.0)), bench_nodes()


@sound
def log_that_begins_in_the_middle():
    """The second half of a motion: no boot-up, no set-up, no NMT start."""
    return played(lambda rig: (rig.start(), rig.move(1.0)))[-400:], bench_nodes()


@sound
def nodes_that_nobody_knows():
    """The same motion without any EDS."""
    return started(), []


@sound
def idle_bus():
    """All boot, and nobody sends anything for two seconds."""
    return played(lambda rig: rig.network.pump(2.0)), bench_nodes()


@sound
def reset_that_was_commanded():
    """The master resets a node and sets it up again."""

    def play(rig):
        rig.start()
        rig.network.reset_node(2)
        rig.set_up(rig.pressure_a)
        rig.move(0.3)

    return played(play), bench_nodes()


@sound
def stop_and_start_again():
    """The master takes all nodes to PRE-OPERATIONAL and STOPPED, and starts them again."""

    def play(rig):
        rig.start()
        rig.network.enter_pre_operational()
        rig.network.pump(1.5)
        rig.network.stop_node()
        rig.network.pump(1.5)
        rig.network.start_node()
        rig.move(0.3)

    return played(play), bench_nodes()


@sound
def every_object_read():
    """A tool reads every readable object of a transducer, texts by segments."""

    def play(rig):
        rig.set_up()
        for variable in load_eds(PRESSURE_404, 2):
            is_empty = variable.index == 0x1003 and variable.subindex
            if variable.access.readable and not is_empty:
                rig.pressure_a.node.upload(variable.index, variable.subindex)

    return played(play), bench_nodes()


@sound
def changes_while_it_runs():
    """Other times of heartbeat and event timer, a heartbeat off, a PDO mapped anew by the book."""

    def play(rig):
        rig.start()
        rig.write(rig.position, 0x1017, 0, 500, "H")
        rig.write(rig.pressure_b, 0x1017, 0, 0, "H")
        rig.write(rig.pressure_b, 0x1800, 5, 400, "H")
        rig.write(rig.pressure_a, 0x1800, 1, 0x80000182)
        rig.write(rig.pressure_a, 0x1A00, 0, 0, "B")
        rig.write(rig.pressure_a, 0x1A00, 1, 0x71300110)
        rig.write(rig.pressure_a, 0x1A00, 0, 1, "B")
        rig.write(rig.pressure_a, 0x1800, 1, 0x40000182)
        rig.move(1.2)

    return played(play), bench_nodes()


@sound
def frames_of_others_and_a_cut_end():
    """29-bit frames between, times with the date, and an end in the middle of an SDO transfer."""
    frames = []
    for number, logged in enumerate(started()):
        frames.append(logged)
        if number % 7 == 0:
            other = Frame(0x18FEF100, bytes(8), is_extended=True)
            frames.append(LoggedFrame(other, logged.now, None))
    request = Frame(0x601, bytes.fromhex("4008100000000000"))
    frames.append(LoggedFrame(request, frames[-1].now + MS, None))
    date = 1_700_000_000_000_000_000
    return [logged._replace(now=logged.now + date) for logged in frames], bench_nodes()


@pytest.mark.parametrize("name", BROKEN)
def test_the_cause_of_a_broken_log_is_found_first(name):
    case = BROKEN[name]
    frames, known = case.make()
    bitrate = 250_000 if case.cause is Cause.BUS_LOAD else BITRATE
    found = explain(frames, known, bitrate).findings
    assert found
    assert (found[0].cause, found[0].node) == (case.cause, case.node), found


@pytest.mark.parametrize("name", SOUND)
def test_nothing_is_found_in_a_sound_log(name):
    frames, known = SOUND[name]()
    assert explain(frames, known, BITRATE).findings == ()


def test_a_pdo_is_judged_by_the_event_timer_that_it_has():
    frames = [
        Frame(0x702, b"\0"),
        Frame(0x000, b"\x01\x02"),
        *[Frame(0x182, bytes(5))] * 5,
        *download(2, 0x1800, 5, struct.pack("<H", 400)),
        Frame(0x182, bytes(5)),
    ]
    logged = heard(*frames, step=10 * MS)
    logged[-1] = logged[-1]._replace(now=logged[-1].now + 300 * MS)
    known = [KnownNode(2, "pressure", load_eds(PRESSURE_404, 2))]
    assert explain(logged, known, BITRATE).findings == ()
    without = [each for each in logged if each.frame.can_id not in {0x602, 0x582}]
    (finding,) = explain(without, known, BITRATE).findings  # 10 ms by the EDS
    assert finding.cause is Cause.PDO_MISSING


@given(
    st.lists(
        st.builds(
            Frame,
            st.one_of(st.integers(0, 0x7FF), st.sampled_from([0x602, 0x582, 0x182, 0x702, 0x80])),
            st.binary(max_size=8),
            st.booleans(),
        ),
        max_size=60,
    ),
    st.booleans(),
)
def test_no_frames_make_it_stumble(frames, are_known):
    nodes = [KnownNode(2, "pressure", load_eds(PRESSURE_404, 2))] if are_known else []
    logged = [LoggedFrame(frame, 100 * MS * n, None) for n, frame in enumerate(frames)]
    assert explain(logged, nodes, BITRATE).frames == len(frames)


def test_there_are_as_many_logs_as_were_promised():
    assert len(BROKEN) >= 20
    assert len(SOUND) >= 10
