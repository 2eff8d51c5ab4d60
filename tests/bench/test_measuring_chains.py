"""Measuring chains in a whole bench: what a controller reads of sensors as they are."""

import math
import struct
from pathlib import Path

import can
import numpy as np
import pytest

from device_profiles import VALVE_408
from hil_bench import VirtualBench, load_config
from hil_bench.bench.assembly import build_bench

VALVE = '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n'
POSITION = '[nodes.position]\nprofile = "encoder_406"\nnode_id = 4\n'


def pressure(name, node_id, chain):
    return (
        f'[nodes.{name}]\nprofile = "pressure_404"\nnode_id = {node_id}\nsource = "P_A"\n'
        f"[nodes.{name}.chain]\n{chain}\n"
    )


@pytest.fixture
def make_bench(tmp_path):
    """Makes a virtual bench of a valve and further nodes."""
    benches = []

    def make(nodes, seed=1):
        path = tmp_path / "bench.toml"
        path.write_text(VALVE + nodes)
        benches.append(VirtualBench(load_config(path, seed=seed)))
        return benches[-1]

    yield make
    for each in benches:
        each.bus.shutdown()


def objects(bench, node_id):
    (node,) = (node for node in bench.bench.nodes if node.node_id == node_id)
    return node.object_dictionary


def readings(bench, node_id, ticks, index=0x6130):
    """Return what an object shows in each of some ticks."""
    seen = []
    for _ in range(ticks):
        bench.run(0.001)
        seen.append(objects(bench, node_id).find(index, 1).value)
    return seen


def test_an_ideal_sensor_passes_no_stage():
    sensors = build_bench(load_config()).axes[0].sensors
    assert all(sensor.path.stages == () for sensor in sensors)


def test_a_transducer_shows_what_its_chain_gives(make_bench):
    made = make_bench(pressure("p", 2, "offset_error_bar = 3.0") + pressure("ideal", 3, ""))
    shown, true = objects(made, 2), objects(made, 3)
    made.run(0.01)
    assert shown.find(0x6130, 1).value == pytest.approx(true.find(0x6130, 1).value + 3.0)


def test_what_a_controller_receives_is_the_measured_value(make_bench):
    made = make_bench(pressure("p", 2, "resolution_bar = 10"))
    made.run(0.002)
    made.bus.send(sdo_read(0x6130, 1))
    message = made.bus.recv(0.1)
    while message.arbitration_id != 0x582:
        message = made.bus.recv(0.1)
    assert struct.unpack("<f", message.data[4:]) == (50.0,)  # P_A at rest is 48.5 bar


def sdo_read(index, subindex):
    data = struct.pack("<BHB4x", 0x40, index, subindex)
    return can.Message(arbitration_id=0x602, data=data, is_extended_id=False)


def test_beyond_the_span_a_transducer_does_what_its_profile_says(make_bench):
    """300 bar too much are beyond the span of 250 bar and its margin; the chain ends at 275."""
    made = make_bench(pressure("p", 2, "offset_error_bar = 300\nrange_bar = [-12.5, 275]"))
    made.run(0.01)
    dictionary = objects(made, 2)
    assert math.isnan(dictionary.find(0x6130, 1).value)
    assert dictionary.find(0x6150, 1).value == 0x03  # not valid, positive overload
    assert any(logged.frame.can_id == 0x082 for logged in made.frames)  # EMCY


def test_a_chain_that_saturates_within_the_span_shows_no_overload(make_bench):
    made = make_bench(pressure("p", 2, "offset_error_bar = 300\nrange_bar = [0, 250]"))
    made.run(0.01)
    assert objects(made, 2).find(0x6130, 1).value == pytest.approx(250.0)
    assert objects(made, 2).find(0x6150, 1).value == 0


def test_a_chain_without_value_is_not_valid_but_no_overload(make_bench):
    made = make_bench(pressure("p", 2, 'range_bar = [100, 200]\nover_range = "invalid"'))
    made.run(0.01)
    assert math.isnan(objects(made, 2).find(0x6130, 1).value)
    assert objects(made, 2).find(0x6150, 1).value == 0x01


def test_a_position_sensor_that_has_lost_its_magnet_shows_a_position_error(make_bench):
    chain = '[nodes.position.chain]\nrange_mm = [5, 10]\nover_range = "invalid"\n'
    made = make_bench(POSITION + chain + "speed_window_us = 2000")
    made.run(0.02)
    dictionary = objects(made, 4)
    assert dictionary.find(0x6503, 0).value == 1  # alarm: position error
    assert dictionary.find(0x6505, 0).value == 0  # no speed is not overspeed
    assert any(logged.frame.can_id == 0x084 for logged in made.frames)


def test_the_same_seed_gives_the_same_bench_and_another_one_another(make_bench):
    noisy = pressure("p", 2, "noise_rms_bar = 0.5")
    first, again, other = (readings(make_bench(noisy, seed), 2, 50) for seed in (1, 1, 2))
    assert first == again
    assert first != other


def test_one_more_sensor_changes_no_other_sensor(make_bench):
    noisy = "noise_rms_bar = 0.5\n"
    alone = readings(make_bench(pressure("p", 2, noisy)), 2, 50)
    before = readings(make_bench(pressure("a", 3, noisy) + pressure("p", 2, noisy)), 2, 50)
    assert alone == before


def test_two_sensors_have_noise_of_their_own(make_bench):
    noisy = "noise_rms_bar = 0.5\n"
    made = make_bench(pressure("p", 2, noisy) + pressure("q", 3, noisy))
    p, q = (
        np.array(values)
        for values in zip(
            *((readings(made, 2, 1)[0], readings(made, 3, 1)[0]) for _ in range(100)), strict=True
        )
    )
    # 100 pairs: a correlation of 0.5 would be five standard deviations.
    assert abs(np.corrcoef(p, q)[0, 1]) < 0.5


def test_an_object_bound_to_the_plant_shows_what_its_chain_gives(make_bench):
    eds = Path(VALVE_408).parent / "imitations" / "analogue_io_401.eds"
    binding = '{ source = "axis1.P_A", unit = "bar", scale = 100, chain = { resolution_bar = 10 } }'
    made = make_bench(
        f'[nodes.io]\neds = "{eds}"\nnode_id = 9\n[nodes.io.objects]\n"0x6401.01" = {binding}\n'
    )
    made.run(0.01)
    assert objects(made, 9).find(0x6401, 1).value == 5000  # P_A at rest is 48.5 bar
