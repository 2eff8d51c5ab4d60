"""Broken logs of PDOs with counter and checksum."""

from dataclasses import replace

from support.bus_logs import CYCLE, played
from support.log_cases import Broken

from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.abilities.eyes.known_node import nodes_of
from hil_bench.bench.configuration import load_config

BROKEN = Broken()

POSITION = 0x184


def protected_bench():
    """Return the built-in bench whose encoder protects its TPDO1."""
    config = load_config()
    nodes = [
        replace(node, protected_tpdos=(1,)) if node.name == "position" else node
        for node in config.nodes
    ]
    return replace(config, nodes=tuple(nodes))


def with_protection(disturb):
    """Return the frames of a motion that `disturb` disturbs for a while, and the nodes."""
    config = protected_bench()

    def play(rig):
        rig.start()
        disturb(rig)
        rig.move(0.1)

    return played(play, config), nodes_of(config)


@BROKEN.played(Cause.PDO_CHECKSUM, "position", with_protection)
def one_wrong_bit_in_a_protected_pdo(rig):
    """A gateway turns a bit of the encoder's TPDO1 round, in each frame for 100 ms."""
    with rig.faults.corrupt("position", can_id=POSITION):
        rig.move(0.1)


@BROKEN.played(Cause.PDO_REPEATED, "position", with_protection)
def sender_that_hangs(rig):
    """The encoder's driver sends the same buffer for 100 ms, with the old counter."""
    with rig.faults.repeat("position", can_id=POSITION):
        rig.move(0.1)


@BROKEN.of(Cause.PDO_REPEATED, "position")
def frame_that_comes_twice():
    """A gateway sends one frame of the encoder twice."""
    frames, known = with_protection(lambda rig: rig.move(CYCLE))
    number = [at for at, logged in enumerate(frames) if logged.frame.can_id == POSITION][20]
    return [*frames[: number + 1], frames[number], *frames[number + 1 :]], known


@BROKEN.played(Cause.PDO_LOST, "position", with_protection)
def frames_that_are_lost_on_the_way(rig):
    """A gateway loses a frame of the encoder, too few for its event timer to show it."""
    with rig.faults.lose("position", can_id=POSITION):
        rig.move(CYCLE)


@BROKEN.played(Cause.PDO_LOST, "position", with_protection)
def gateway_that_pauses(rig):
    """A gateway loses the frames of the encoder for 200 ms: its counter shows that it sent them."""
    with rig.faults.lose("position", can_id=POSITION):
        rig.move(0.2)


@BROKEN.of(Cause.PDO_LOST, "position")
def frames_that_overtake_each_other():
    """A gateway exchanges two frames of the encoder."""
    frames, known = with_protection(lambda rig: rig.move(CYCLE))
    one, two = [at for at, logged in enumerate(frames) if logged.frame.can_id == POSITION][20:22]
    first, second = frames[one], frames[two]
    frames[one], frames[two] = second._replace(now=first.now), first._replace(now=second.now)
    return frames, known
