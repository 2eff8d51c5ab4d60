"""Logs in which nothing is wrong."""

import functools

from support.broken_messages import every_fourth_sync
from support.broken_protection import protected_bench
from support.bus_logs import played
from support.log_cases import Make, bench_nodes, on_the_bench, started
from support.sdo_frames import MS

from device_profiles import PRESSURE_404
from hil_bench.abilities.eyes.known_node import nodes_of
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import LoggedFrame

SOUND: dict[str, Make] = {}


def sound(make):
    """Register what makes a log."""
    SOUND[make.__name__] = make
    return make


def played_sound(play):
    """Register what happens to a rig, whose log it makes."""
    SOUND[play.__name__] = functools.partial(on_the_bench, play)
    return play


@sound
def motion_with_pdos_on_event():
    """The master sets all up, starts them and moves the axis."""
    return started(), bench_nodes()


@sound
def motion_with_sync():
    """The same with SYNC every 10 ms and TPDOs of type 1."""
    return played(lambda rig: rig.start(transmission_type=1, event_timer=0.0)), bench_nodes()


@sound
def pdo_that_follows_every_fourth_sync():
    """TPDO1 of pressure_a is of type 4."""
    return played(every_fourth_sync), bench_nodes()


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


@played_sound
def reset_that_was_commanded(rig):
    """The master resets a node and sets it up again."""
    rig.start()
    rig.network.reset_node(2)
    rig.set_up(rig.pressure_a)
    rig.move(0.3)


@played_sound
def stop_and_start_again(rig):
    """The master takes all nodes to PRE-OPERATIONAL and STOPPED, and starts them again."""
    rig.start()
    rig.network.enter_pre_operational()
    rig.network.pump(1.5)
    rig.network.stop_node()
    rig.network.pump(1.5)
    rig.network.start_node()
    rig.move(0.3)


@played_sound
def every_object_read(rig):
    """A tool reads every readable object of a transducer, texts by segments."""
    rig.set_up()
    for variable in load_eds(PRESSURE_404, 2):
        is_empty = variable.index == 0x1003 and variable.subindex
        if variable.access.readable and not is_empty:
            rig.pressure_a.node.upload(variable.index, variable.subindex)


@played_sound
def changes_while_it_runs(rig):
    """Other times of heartbeat and event timer, a heartbeat off, a PDO mapped anew by the book."""
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


@sound
def protected_pdo_whose_counter_goes_round():
    """The encoder protects its PDO, sends 300 of them, is reset by the master and goes on."""
    config = protected_bench()

    def play(rig):
        rig.start()
        rig.move(3.0)
        rig.network.reset_node(4)
        rig.set_up(rig.position)
        rig.move(0.3)

    return played(play, config), nodes_of(config)
