"""What the configuration says reaches the parts it speaks of."""

import pytest

from hil_bench.assembly import build_bench, embedded_bus
from hil_bench.config import load_config
from hil_bench.errors import ConfigError
from hil_bench.plant import Solver

OTHER_BENCH = """
[bench]
tick_us = 2000
step_us = 50

[plant.lift]
solver = "forward-euler"
supply_pressure_bar = 120.0
position_mm = 30.0
end_stop = false

[nodes.valve]
profile = "valve_408"
node_id = 9
full_opening_mm = 2.6

[nodes.position]
profile = "encoder_406"
node_id = 12
"""


@pytest.fixture
def config(tmp_path):
    (tmp_path / "bench.toml").write_text(OTHER_BENCH)
    return load_config(tmp_path / "bench.toml")


def test_the_plant_is_the_configured_one(config):
    axis = build_bench(config).axes[0]
    assert axis.name == "lift"
    assert axis.plant.parameters.P_S == 12e6
    assert axis.plant.solver is Solver.FORWARD_EULER
    assert axis.plant.options.end_stop is None
    assert axis.plant.dt == pytest.approx(50e-6)
    assert axis.plant.state.x == pytest.approx(0.03)


def test_the_devices_are_the_configured_ones(config):
    bench = build_bench(config)
    assert [node.node_id for node in bench.nodes] == [9, 12]
    assert bench.axes[0].valve.full_opening == pytest.approx(2.6e-3)
    assert len(bench.axes[0].sensors) == 1


def test_an_embedded_bus_ticks_at_the_configured_period(config):
    with embedded_bus(config) as bus:
        boot_up = bus.recv(1.0)
    assert boot_up.arbitration_id == 0x709
    assert boot_up.timestamp == pytest.approx(0.002)  # the first tick, 2000 us


def test_the_tick_runs_all_plant_steps(config):
    # 40 steps of 50 us in a tick of 2 ms: the spool of Table I under a full step, by the exact
    # solution of eq. (3) at 2 ms: 1 - e^-1.68 (cos mu + 1.68 / mu sin mu), mu = 1.71393; by hand
    # 1 - 0.18637 (-0.14265 + 0.98020 * 0.98977) = 0.8458; forward Euler is within 2 %.
    bench = build_bench(config)
    plant, u = bench.axes[0].plant, 1e-3
    bench.axes[0].valve.command = lambda _now: u
    bench.start(0)
    bench.tick([], config.tick_ns)
    assert plant.state.nu / u == pytest.approx(0.8458, rel=0.02)


def test_a_valve_without_its_objects_is_refused(tmp_path):
    (tmp_path / "bench.toml").write_text(
        OTHER_BENCH.replace('profile = "valve_408"', 'profile = "valve_408"\neds = "sensor.eds"')
    )
    eds = next(node.eds for node in load_config().nodes if node.profile == "encoder_406")
    (tmp_path / "sensor.eds").write_bytes(eds.read_bytes())
    with pytest.raises(ConfigError, match=r"sensor\.eds: .*0x6040"):
        build_bench(load_config(tmp_path / "bench.toml"))
