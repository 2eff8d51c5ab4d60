"""The NMT commands that bring a twin's nodes to the states that a machine's frames show."""

import can
import pytest

from hil_bench.abilities.shadow.followed_valve import NodeStates
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import load_config
from hil_bench.canopen_device.nmt import NmtState


@pytest.fixture
def nodes():
    """The nodes of the built-in bench after their boot-up."""
    bench = build_bench(load_config())
    bench.start(0)
    bench.tick((), 0)
    return bench.nodes


def frame(text):
    """Return a frame from text as cansend takes it."""
    identifier, data = text.split("#")
    return can.Message(
        arbitration_id=int(identifier, 16), data=bytes.fromhex(data), is_extended_id=False
    )


def commands(states, text, time=1.0):
    return [sent.data.hex() for sent in states.hear(frame(text), time)]


def test_a_pdo_shows_that_its_node_is_operational(nodes):
    states = NodeStates(nodes)
    assert commands(states, "181#09000000") == ["0101"]
    assert states.reported == {1: NmtState.OPERATIONAL}


@pytest.mark.parametrize(
    ("told", "command"),
    [("05", "0104"), ("85", "0104"), ("04", "0204"), ("7f", ""), ("03", "")],
    ids=["heartbeat", "guarding with its toggle bit", "stopped", "as the twin is", "no state"],
)
def test_an_error_control_frame_shows_the_state(nodes, told, command):
    assert commands(NodeStates(nodes), f"704#{told}") == ([command] if command else [])


def test_a_pdo_that_left_before_a_stop_command_was_obeyed_shows_nothing(nodes):
    states = NodeStates(nodes)
    assert commands(states, "000#0201", 1.0) == []
    assert commands(states, "181#09000000", 1.005) == []
    assert commands(states, "181#09000000", 1.025) == ["0101"]  # it goes on


def test_a_boot_up_that_nobody_commanded_resets_the_twins_node(nodes):
    states = NodeStates(nodes)
    assert commands(states, "702#00") == ["8102"]
    assert states.reported[2] is NmtState.PRE_OPERATIONAL


@pytest.mark.parametrize("command", ["8102", "8200"], ids=["reset node", "communication, all"])
def test_a_boot_up_that_follows_a_command_is_the_twins_too(nodes, command):
    states = NodeStates(nodes)
    commands(states, f"000#{command}")
    assert commands(states, "702#00", 1.2) == []
    assert commands(states, "702#00", 9.0) == ["8102"]  # the second one has no such cause


def test_frames_of_nobodys_nodes_and_malformed_ones_show_nothing(nodes):
    states = NodeStates(nodes)
    for text in ("000#01", "000#FF01", "705#05", "704#", "704#0505", "4A1#00"):
        assert commands(states, text) == []
    remote = can.Message(arbitration_id=0x701, is_remote_frame=True, dlc=1, is_extended_id=False)
    assert states.hear(remote, 1.0) == []
