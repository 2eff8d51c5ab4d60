"""Several axes on one bus."""

from pathlib import Path

from support.bus_side import BusSide

from hil_bench.bench.configuration import load_config
from hil_bench.canopen_device.frame import Frame

TWO_AXES = Path(__file__).parents[2] / "examples" / "two_axes.toml"


def test_each_valve_moves_its_own_cylinder():
    config = load_config(TWO_AXES)
    bus = BusSide(config)
    bus.tick()
    bus.nmt(0x01)
    first, second = (next(n for n in config.nodes if n.axis == a.name) for a in config.axes)
    start = [axis.plant.state.x for axis in bus.bench.axes]
    for _ in range(200):
        bus.tick(Frame(0x200 + second.node_id, bytes.fromhex("07000020")))
    moved = [axis.plant.state.x - x for axis, x in zip(bus.bench.axes, start, strict=True)]
    assert first.profile == second.profile == "valve_408"
    assert abs(moved[0]) < 1e-6
    assert moved[1] > 1e-3
