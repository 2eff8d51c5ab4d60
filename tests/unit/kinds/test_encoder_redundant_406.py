"""A redundant encoder on a bench: two channels that a fault tells apart."""

import pytest

from device_profiles import ENCODER_REDUNDANT_406
from hil_bench import VirtualBench, embedded_bus
from hil_drivers import Network, PositionSensor

BENCH = """\
[nodes.valve]
profile = "valve_408"
node_id = 1

[nodes.encoder]
profile = "encoder_redundant_406"
node_id = 4
"""


@pytest.fixture
def config(load_bench):
    return load_bench(BENCH)


def test_the_drivers_read_both_channels(config):
    with embedded_bus(config) as bus, Network(bus, clock=bus.now) as network:
        channels = [PositionSensor(network, 4, ENCODER_REDUNDANT_406, channel=n) for n in (1, 2)]
        for sensor in channels:
            sensor.setup()
        network.start_node()
        network.sync()
        network.pump(0.01)
        assert channels[0].primary.signal != channels[1].primary.signal
        assert channels[0].position == channels[1].position


def test_a_fault_of_one_channel_leaves_the_other(config):
    with VirtualBench(config) as bench:
        bench.faults.drift("encoder.2", rate=1.0)
        bench.run(0.1)
        first, second = (bench.nodes["encoder"][f"0x6020.0{n}"] for n in (1, 2))
    # 1 m/s for 0.1 s are 100 mm, 100,000 steps of 1 um.
    assert second - first == pytest.approx(100_000, rel=0.02)
