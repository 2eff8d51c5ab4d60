"""A transducer of two pressures and a temperature on a bench, read by the drivers.

The default cylinder rests with both chambers under pressure; a pressure_404 beside each channel
tells what is right.
"""

import pytest

from device_profiles import ENCODER_REDUNDANT_406, PRESSURE_404, TRANSDUCER_404
from hil_bench import ConfigError, VirtualBench, embedded_bus
from hil_drivers import Network, PositionSensor, PressureSensor, TemperatureSensor
from hil_drivers.errors import DeviceMismatchError

VALVE = '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n'
TRANSDUCER = '[nodes.t]\nprofile = "transducer_404"\nnode_id = 2\ntemperature_c = 55.0\n'
SINGLES = "".join(
    f'[nodes.{name}]\nprofile = "pressure_404"\nnode_id = {node}\nsource = "{source}"\n'
    for name, node, source in (("a", 3, "P_A"), ("b", 4, "P_B"))
)


@pytest.fixture
def load(load_bench):
    return lambda text: load_bench(VALVE + text)


def test_the_drivers_read_every_channel(load):
    with embedded_bus(load(TRANSDUCER + SINGLES)) as bus, Network(bus, clock=bus.now) as network:
        channels = [PressureSensor(network, 2, TRANSDUCER_404, channel=n) for n in (1, 2)]
        singles = [PressureSensor(network, node, PRESSURE_404) for node in (3, 4)]
        temperature = TemperatureSensor(network, 2, TRANSDUCER_404, channel=3)
        for sensor in (*channels, *singles, temperature):
            sensor.setup()
        network.start_node()
        network.sync()
        network.pump(0.01)
        assert temperature.temperature == pytest.approx(55.0)
        assert temperature.reading.unit == "°C"
        found = [sensor.pressure for sensor in channels]
        assert found == pytest.approx([sensor.pressure for sensor in singles])
        assert found[0] > 1e6
        assert found[0] != pytest.approx(found[1])


def test_a_pressure_driver_on_the_temperature_says_so(load):
    with embedded_bus(load(TRANSDUCER)) as bus, Network(bus, clock=bus.now) as network:
        sensor = PressureSensor(network, 2, TRANSDUCER_404, channel=3)
        with pytest.raises(DeviceMismatchError, match=r"0x6131\.03.*no pressure"):
            sensor.setup()


def test_an_unknown_second_source_is_one_line(load):
    with pytest.raises(ConfigError, match=r'second_source: "oil" is unknown; give one of "P_A"'):
        load(TRANSDUCER + 'second_source = "oil"\n')


# A redundant encoder on a bench: two channels that a fault tells apart.


BENCH = """\
[nodes]
valve = { profile = "valve_408", node_id = 1 }
encoder = { profile = "encoder_redundant_406", node_id = 4 }
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
