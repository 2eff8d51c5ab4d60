"""Nodes without a plant: objects that follow a script, seen on the bus and from Python."""

import math
import struct
from itertools import pairwise
from pathlib import Path

import can
import pytest
from support.tables import from_text

from device_profiles import IMITATIONS
from hil_bench import ConfigError, VirtualBench, load_config

EXAMPLE = Path(__file__).parents[2] / "examples" / "scripted_nodes.toml"
IO = IMITATIONS / "analogue_io_401.eds"
TPDO2 = 0x28A


@pytest.fixture
def bench_of(tmp_path, monkeypatch):
    """Return what makes a bench of a module whose objects are given; by event alone."""
    monkeypatch.chdir(tmp_path)

    def make(*objects):
        lines = "\n".join(objects)
        text = (
            '[plant.axis1]\nkind = "none"\n'
            f'[nodes.io]\nnode_id = 10\neds = "{IO}"\n'
            f'[nodes.io.objects]\n"0x1801.05" = 0\n{lines}\n'
        )
        Path("b.toml").write_text(text)
        return VirtualBench(load_config("b.toml"))

    return make


def refusal(bench_of, *objects):
    with pytest.raises(ConfigError) as error, bench_of(*objects):
        pass
    return str(error.value)


def value(bench, name="0x6401.01"):
    return bench.nodes["io"][name]


def send(bench, can_id, data):
    bench.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))


def sent(bench):
    return [each.frame.data for each in bench.frames if each.frame.can_id == TPDO2]


def test_the_first_tick_is_the_start_of_a_script(bench_of):
    with bench_of('"0x6401.01" = { ramp = [100, 1100], over_s = 0.1 }') as bench:
        bench.run(0.001)
        assert value(bench) == 100
        bench.run(0.05)  # half of the way
        assert value(bench) == 600
        bench.run(0.2)
        assert value(bench) == 1100


@pytest.mark.parametrize(
    ("script", "expected"),
    [
        # After 30 ms: 1 ms for the first tick, which is time 0, then 30 ticks.
        ("{ constant = 4660 }", 4660),
        ("{ ramp = [0, 1000], over_s = 0.02, repeat = true }", 500),
        ("{ sine = 1000, offset = 50, period_s = 0.12 }", 1050),  # sin(90 degrees)
        ("{ sine = 1000, period_s = 0.12, phase_deg = 90 }", 0),  # sin(180 degrees)
        ("{ table = [[0.01, 5], [0.02, 100], [0.04, 300]] }", 200),
        ("{ table = [[0.5, -7], [1, 0]] }", -7),
    ],
)
def test_a_script_shows_its_value_at_a_time(bench_of, script, expected):
    with bench_of(f'"0x6401.01" = {script}') as bench:
        bench.run(0.031)
        assert value(bench) == expected


def test_an_object_follows_what_the_bus_writes_with_its_lag(bench_of):
    follow = '"0x6401.04" = { follow = "0x6411.01", scale = 2, offset = 10, lag_ms = 20 }'
    with bench_of(follow, '"0x6401.03" = { follow = "0x6411.01" }') as bench:
        bench.run(0.005)
        assert value(bench, "0x6401.04") == 10
        send(bench, 0x000, b"\x01\x00")
        send(bench, 0x30A, struct.pack("<hh", 1000, 0))
        bench.run(0.020)
        assert value(bench, "0x6401.03") == 1000
        # 20 ticks of a first-order lag of 20 ms: 1 - 1/e of the way
        expected = 10 + 2 * 1000 * (1 - math.exp(-1.0))
        assert value(bench, "0x6401.04") == pytest.approx(expected, abs=0.5)


def test_a_change_by_more_than_delta_is_an_event(bench_of):
    ramp = '"0x6401.01" = { ramp = [0, 1000], over_s = 0.1, delta = 99 }'
    with bench_of(ramp) as bench:
        bench.run(0.001)
        send(bench, 0x000, b"\x01\x00")
        bench.run(0.2)
        shown = [struct.unpack("<hhhh", data)[0] for data in sent(bench)]
        assert shown[-1] == 1000
        # The start sends one; then, with 10 increments a tick, the first change above 99 is 100.
        changes = [after - before for before, after in pairwise(shown)][1:]
        assert changes == [100] * len(changes)
        assert len(changes) >= 9


def test_a_scripted_object_cannot_be_set_beside_its_script(bench_of):
    with bench_of('"0x6401.01" = { constant = 1 }') as bench:
        with pytest.raises(ConfigError, match="follows a script in each tick"):
            bench.nodes["io"]["0x6401.01"] = 5
        bench.nodes["io"]["0x6401.02"] = 7
        assert value(bench, "0x6401.02") == 7


def test_a_value_beyond_the_object_stops_at_its_limit(bench_of):
    with bench_of('"0x6401.01" = { constant = 1e9 }') as bench:
        bench.run(0.002)
        assert value(bench) == 32767


@from_text("objects", "said")
def test_a_wrong_script_is_one_line(bench_of, objects, said):
    message = refusal(bench_of, objects)
    assert message.startswith(f"b.toml:nodes.io.objects.{said}")
    assert "\n" not in message


@from_text("text", "said")
def test_no_plant_has_no_keys_and_no_valve(tmp_path, monkeypatch, text, said):
    monkeypatch.chdir(tmp_path)
    Path("b.toml").write_text(text)
    with pytest.raises(ConfigError) as error:
        load_config("b.toml")
    assert str(error.value).startswith(said)


def test_the_example_lives_without_a_plant():
    with VirtualBench(load_config(EXAMPLE)) as bench:
        assert bench.config.axes == ()
        bench.run(0.501)
        assert value(bench) == 15000  # a quarter of the sine's period
        assert value(bench, "0x6401.02") == round(27648 * 0.05)
        assert value(bench, "0x6401.03") == 0
        bench.run(1.0)
        assert value(bench, "0x6401.03") == 20000


def test_the_same_frames_at_every_run():
    def frames():
        with VirtualBench(load_config(EXAMPLE)) as bench:
            bench.run(0.001)
            send(bench, 0x000, b"\x01\x00")
            bench.run(0.3)
            return [tuple(each) for each in bench.frames]

    assert frames() == frames()
