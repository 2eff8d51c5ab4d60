"""A valve that controls the position of its axis itself (CiA 408, control mode 9), and its twin."""

import pytest
from support.built_in_nodes import NODES

from hil_bench import VirtualBench, load_config
from hil_bench.abilities.recording.frames import message_of
from hil_bench.abilities.shadow.twin import Shadow
from hil_drivers import ControlMode, Network, ProportionalValve

POSITIONS = (0.1, 0.2, 0.05, 0.15)
STEP = 0.5
"""Time between two of them [s]."""

MACHINE = """
[plant.axis1]
load_n = 20000
internal_leakage_l_min_bar = 0.02
"""
WITH_INTEGRAL = '"0x6043" = 9, "0x2600.02" = 300'


@pytest.fixture
def load(tmp_path):
    """Return what loads the machine with objects of its valve."""

    def load(objects=""):
        path = tmp_path / "machine.toml"
        valve = f'node_id = 1, position_source = "position", objects = {{ {objects} }} }}'
        path.write_text(MACHINE + NODES.replace("node_id = 1 }", valve), encoding="utf-8")
        return load_config(path)

    return load


def life(config, *, sticks=False):
    """Return the frames of a machine whose controller gives axis positions alone."""
    with VirtualBench(config) as machine, Network(machine.bus, clock=machine.now) as network:
        for node in config.nodes:
            network.add_node(node.node_id, node.eds)
        valve = ProportionalValve(network, node_id=1)
        valve.setup(transmission_type=254, event_timer=0.005, command_timeout=0.0)
        valve.set_control_mode(ControlMode.AXIS_POSITION)
        network.start_node()
        valve.set_axis_position(valve.read_axis_position())
        valve.enable()
        network.pump(0.2)
        for number, position in enumerate(POSITIONS):
            if sticks and number == 2:
                machine.faults.stick("valve")
            valve.set_axis_position(position)
            for _ in range(10):
                valve.send()  # control word and spool set-point, which does not count
                network.pump(STEP / 10)
        return [message_of(logged) for logged in machine.frames]


def follow(frames, config, begin=0.0):
    shadow = Shadow(config, horizon=0.2)
    for message in frames:
        if message.timestamp >= begin:
            shadow.take(message)
    shadow.finish()
    return shadow


def worst(shadow, quantity):
    return max(window.residuals[quantity].rms for window in shadow.windows)


def setpoints(frames):
    """Return when a master wrote 0x6600.01, from the SDO downloads of four bytes."""
    return [
        each.timestamp
        for each in frames
        if each.arbitration_id == 0x601 and bytes(each.data[:4]) == bytes.fromhex("23006601")
    ]


def test_the_twin_closes_the_loop_as_the_machine_does(load):
    config = load()
    frames = life(config)
    shadow = follow(frames, config)

    assert len(shadow.windows) >= 9  # of 2.2 s
    assert worst(shadow, "position") < 0.05e-3
    assert worst(shadow, "spool_position") < 0.01
    assert shadow.axes["axis1"].missing(shadow.now) == {}


def test_a_spool_that_sticks_shows(load):
    config = load()
    shadow = follow(life(config, sticks=True), config)

    # The set-point goes 150 mm back while the spool stays where 200 mm had left it.
    assert worst(shadow, "spool_position") > 0.2


def test_a_twin_that_joins_later_waits_for_the_axis_set_point(load):
    config = load(WITH_INTEGRAL)
    frames = life(config)
    third = setpoints(frames)[3]
    before = [each for each in frames if each.timestamp < third]
    waiting = follow(before, config, third - 0.3)

    # Spool set-points were heard with each control word, and do not count in this mode.
    assert waiting.axes["axis1"].missing(waiting.now) == {
        "set-point": "not heard, and the valve is ACTIVE in control mode 9"
    }
    assert not waiting.windows

    shadow = follow(frames, config, third - 0.3)
    assert len(shadow.windows) >= 3  # of 1 s
    assert worst(shadow, "position") < 0.3e-3
    assert worst(shadow, "spool_position") < 0.03
