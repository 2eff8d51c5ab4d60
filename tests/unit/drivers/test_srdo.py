"""The encoder's SRDO on a bench, read by the drivers, and its faults."""

import pytest

from device_profiles import ENCODER_REDUNDANT_406
from hil_bench.bench.virtual_bench import VirtualBench
from hil_drivers import Network, StaleValueError
from hil_drivers.srdo import SafetyInput

BENCH = """\
[nodes]
valve = { profile = "valve_408", node_id = 1 }
encoder = { profile = "encoder_redundant_406", node_id = 4 }
"""
POSITION, SPEED = (0x6020, 1), (0x6030, 1)
PLAIN, INVERTED = 0xFF + 2 * 4, 0x100 + 2 * 4


@pytest.fixture
def rig(load_bench):
    with VirtualBench(load_bench(BENCH)) as bench, Network(bench.bus, clock=bench.now) as network:
        network.pump(0.01)
        node = network.add_node(4, ENCODER_REDUNDANT_406)
        safety = SafetyInput(network, node)
        safety.setup(refresh=0.01, sct=0.03, srvt=0.005)
        network.start_node()
        network.pump(0.1)
        yield bench, network, safety


def test_the_pair_brings_position_and_speed(rig):
    bench, _, safety = rig
    objects = bench.nodes["encoder"]
    assert safety.value(*POSITION) == objects["0x6020.01"]
    assert safety.value(*SPEED) == objects["0x6030.01"]
    assert safety.counters.accepted >= 9
    counters = safety.counters
    assert (counters.missing, counters.mismatched, counters.late) == (0, 0, 0)


@pytest.mark.parametrize(
    ("fault", "more", "counter"),
    [
        ("lose", {"direction": "sent"}, "missing"),  # the second frame is missing
        ("corrupt", {}, "mismatched"),  # a bit of it is not inverted
        ("delay", {"time": 0.007, "direction": "sent"}, "late"),  # it comes too late
    ],
)
def test_what_is_wrong_with_the_second_frame_is_seen(rig, fault, more, counter):
    bench, network, safety = rig
    with getattr(bench.faults, fault)("encoder", can_id=INVERTED, **more):
        network.pump(0.1)
        with pytest.raises(StaleValueError, match="no valid pair of frames"):
            safety.value(*POSITION)
    assert getattr(safety.counters, counter) >= 8
    network.pump(0.05)
    safety.value(*POSITION)


def test_a_device_that_falls_silent_is_seen(rig):
    bench, network, safety = rig
    with bench.faults.silence("encoder"):
        network.pump(0.05)
        with pytest.raises(StaleValueError):
            safety.value(*POSITION)


def test_an_object_that_is_not_carried_is_told(rig):
    with pytest.raises(KeyError, match=r"0x6020\.02"):
        rig[2].value(0x6020, 2)


def test_times_that_cannot_be_are_refused(rig):
    with pytest.raises(ValueError, match="less than the SCT"):
        rig[2].setup(refresh=0.05, sct=0.03)
