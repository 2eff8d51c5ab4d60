"""The receiver's check, and a bench that sends protected PDOs to the drivers.

CRC-8 SAE J1850 of the ASCII digits 1 to 9 is 0x4B (its published check value).
"""

import pytest
from support.tables import from_text

from hil_bench import ConfigError, VirtualBench, load_config
from hil_bench.bench.assembly import build_bench
from hil_bench.canopen_device.pdo_parameters import Seal
from hil_drivers import Network, PositionSensor, StaleValueError
from hil_drivers.protection import Protection, crc8

COB_ID = 0x184
BENCH = """\
[nodes.valve]
profile = "valve_408"
node_id = 1

[nodes.encoder]
profile = "encoder_406"
node_id = 4
"""


def test_the_checksum_has_its_published_check_value():
    assert crc8(b"123456789") == 0x4B


def test_the_bench_seals_what_the_receiver_opens_in_any_round():
    seal, protection = Seal(), Protection(COB_ID)
    frames = [seal.close(COB_ID, b"abc") for _ in range(300)]
    assert [protection.open(frame) for frame in frames] == [b"abc"] * 300
    assert (protection.accepted, protection.lost) == (300, 0)


@pytest.fixture
def load(tmp_path):
    def load(numbers="[1]", more=""):
        path = tmp_path / "bench.toml"
        text = f"{BENCH}protected_tpdos = {numbers}\n{more}"
        path.write_text(text, encoding="utf-8")
        return load_config(path)

    return load


@pytest.fixture
def rig(load):
    with VirtualBench(load()) as bench, Network(bench.bus, clock=bench.now) as network:
        sensor = PositionSensor(network, 4)
        sensor.setup(transmission_type=254, event_timer=0.01, protected=True)
        network.start_node()
        network.pump(0.05)
        yield bench, network, sensor


def test_the_driver_reads_a_protected_position(rig):
    bench, _, sensor = rig
    (protection,) = sensor.protections
    assert protection.accepted >= 4
    assert (protection.wrong_crc, protection.repeated, protection.lost) == (0, 0, 0)
    assert sensor.position == pytest.approx(bench.signals["axis1.position"][-1], abs=1e-6)


@pytest.mark.parametrize(
    ("fault", "counter"), [("repeat", "repeated"), ("corrupt", "wrong_crc"), ("silence", None)]
)
def test_what_goes_wrong_makes_the_value_stale(rig, fault, counter):
    bench, network, sensor = rig
    with getattr(bench.faults, fault)("encoder"):
        network.pump(0.15)
        with pytest.raises(StaleValueError):
            _ = sensor.position
    (protection,) = sensor.protections
    if counter is not None:
        assert getattr(protection, counter) >= 10
    network.pump(0.05)
    assert sensor.age < 0.02


def test_lost_frames_show_by_the_counter(rig):
    bench, network, sensor = rig
    with bench.faults.lose("encoder", 1.0, direction="sent", can_id=COB_ID):
        network.pump(0.05)
    network.pump(0.05)
    assert sensor.protections[0].lost >= 4


def test_an_unprotected_sensor_is_refused_where_protection_is_asked_for(load):
    with VirtualBench(load("[]")) as bench, Network(bench.bus, clock=bench.now) as network:
        sensor = PositionSensor(network, 4)
        sensor.setup(transmission_type=254, event_timer=0.01, protected=True)
        network.start_node()
        network.pump(0.05)
        with pytest.raises(StaleValueError):
            _ = sensor.position


def test_a_mapping_that_leaves_no_room_is_refused(load):
    with VirtualBench(load()) as bench, Network(bench.bus, clock=bench.now) as network:
        network.pump(0.01)
        node = PositionSensor(network, 4).node
        node.write(0x1800, 1, 0xC0000184)
        node.write(0x1A00, 0, 0)
        node.write(0x1A00, 3, 0x60400110)
        with pytest.raises(Exception, match="0x06040042"):
            node.write(0x1A00, 0, 3)
        node.write(0x1A00, 0, 2)


@from_text("numbers", "more", "told")
def test_what_cannot_be_protected_is_told_in_one_line(load, numbers, more, told):
    with pytest.raises(ConfigError, match=told):
        build_bench(load(numbers, more))
