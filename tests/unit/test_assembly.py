"""What the configuration says reaches the parts it speaks of."""

import pytest

from device_profiles import VALVE_408
from hil_bench.bench.assembly import build_bench, embedded_bus
from hil_bench.bench.configuration import load_config
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ConfigError, EdsError
from hil_bench.plants.hydraulic_cylinder.model import Solver
from hil_drivers import Network

OTHER_BENCH = """
[bench]
tick_us = 2000
step_us = 50

[plant.lift]
solver = "forward-euler"
supply_pressure_bar = 120.0
position_mm = 30.0
end_stop = false

[nodes]
valve = { profile = "valve_408", node_id = 9, full_opening_mm = 2.6 }
position = { profile = "encoder_406", node_id = 12 }
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


def test_an_embedded_bus_begins_with_devices_that_answer():
    """The first request is answered within two ticks; a lost one costs a time-out."""
    with embedded_bus() as bus, Network(bus, clock=bus.now) as network:
        begin = bus.now()
        assert network.add_node(1).upload(0x1000)[:2] == (408).to_bytes(2, "little")
        assert bus.now() - begin <= 2e-3


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
        OTHER_BENCH.replace('"valve_408"', '"valve_408", eds = "sensor.eds"')
    )
    eds = next(node.eds for node in load_config().nodes if node.profile == "encoder_406")
    (tmp_path / "sensor.eds").write_bytes(eds.read_bytes())
    with pytest.raises(ConfigError, match=r"sensor\.eds: .*0x6040"):
        build_bench(load_config(tmp_path / "bench.toml"))


class BenchRig:
    """A bench whose valve is asked by SDO, one tick of 2 ms at a time."""

    def __init__(self, path):
        self.bench = build_bench(load_config(path))
        self.now = 0
        self.bench.start(0)
        self.sent = self.bench.tick([], 0)

    def request(self, node_id, text):
        """Send one SDO request and return the answer's data."""
        self.now += 2_000_000
        sent = self.bench.tick([Frame(0x600 + node_id, bytes.fromhex(text))], self.now)
        (answer,) = [frame.data for frame in sent if frame.can_id == 0x580 + node_id]
        return answer.hex()

    def configure(self, *texts):
        """Send LSS messages and return the identifiers of what was sent."""
        sent = []
        for text in texts:
            self.now += 2_000_000
            sent += self.bench.tick([Frame(0x7E5, bytes.fromhex(text).ljust(8, b"\0"))], self.now)
        return [frame.can_id for frame in sent]


def write_bench(tmp_path, *lines):
    path = tmp_path / "bench.toml"
    path.write_text("\n".join(("[bench]\ntick_us = 2000\n[nodes.valve]", *lines)))
    return path


VALVE = 'profile = "valve_408"'


def test_what_a_device_stores_survives_the_end_of_the_bench(tmp_path):
    path = write_bench(tmp_path, VALVE, "node_id = 9", 'storage = "kept"')
    first = BenchRig(path)
    assert first.request(9, "2b 14 63 01 00 01 00 00").startswith("60")  # hold set-point := 256
    assert first.request(9, "23 10 10 01 73 61 76 65").startswith("60")  # "save"
    assert (tmp_path / "kept" / "valve.parameters").is_file()

    assert BenchRig(path).request(9, "40 14 63 01 00 00 00 00") == "4b14630100010000"


def test_a_damaged_file_is_told_by_emcy_and_the_defaults_hold(tmp_path):
    path = write_bench(tmp_path, VALVE, "node_id = 9", 'storage = "kept"')
    first = BenchRig(path)
    first.request(9, "2b 14 63 01 00 01 00 00")
    first.request(9, "23 10 10 01 73 61 76 65")
    file = tmp_path / "kept" / "valve.parameters"
    file.write_bytes(file.read_bytes()[:-1])

    second = BenchRig(path)
    assert Frame(0x089, bytes.fromhex("3055 01 0000000000")) in second.sent
    assert second.bench.nodes[0].storage_problem.startswith(f"{file}: is damaged")
    assert second.request(9, "40 14 63 01 00 00 00 00") == "4b14630100000000"


def test_a_node_without_node_id_gets_it_by_lss_and_keeps_it(tmp_path):
    path = write_bench(
        *(tmp_path, VALVE, 'node_id = "unconfigured"', "serial_number = 5", 'storage = "kept"')
    )
    rig = BenchRig(path)
    assert rig.sent == []
    # Fastscan: vendor 0, product 0x408, revision 0x10000, serial number 5; node-ID 20; store.
    sent = rig.configure(
        *("51 00000000 80", "51 00000000 00 00 01", "51 08040000 00 01 02"),
        *("51 00000100 00 02 03", "51 05000000 00 03 00", "11 14", "17", "04 00"),
    )
    assert sent == [0x7E4] * 7 + [0x714]
    assert rig.request(20, "40 18 10 04 00 00 00 00") == "4318100405000000"

    assert BenchRig(path).sent[0].can_id == 0x714


def test_a_serial_number_needs_its_object(tmp_path):
    text = VALVE_408.read_text(encoding="ascii")
    start = text.index("[1018sub4]")
    end = text.index("[", start + 1)
    (tmp_path / "v.eds").write_text(text[:start] + text[end:])
    lines = (VALVE, "node_id = 9", "serial_number = 5", 'eds = "v.eds"')
    with pytest.raises(EdsError, match=r"v\.eds: object 0x1018\.04, the serial number, is missing"):
        BenchRig(write_bench(tmp_path, *lines))
