"""Fixtures for tests of a controller against the bench, on the virtual or on the physical bus.

    def test_holds_position(bench, valve, position):
        valve.enable()
        valve.spool_setpoint = 0.4
        bench.run_until(lambda: position.position > 0.05, timeout=2.0)

Every test gets a fresh bench in virtual time. With ``--hil-interface`` the fixtures `can_bus`,
`network`, `valve`, `pressure` and `position` bind the physical bus instead, and a test that asks
for `bench` is skipped.

The module loads in every pytest run of its environment, so it imports nothing of weight before a
fixture asks.
"""

import re
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    import can

    from drivers import Network, PositionSensor, PressureSensor, ProportionalValve
    from drivers.device import Device
    from hil_bench.config import BenchConfig, NodeConfig
    from hil_bench.faults.faults import Faults
    from hil_bench.virtual_bench import VirtualBench

CONTROLLER_ID = 127
"""Node-ID under which the `network` fixture sends its heartbeat."""

HEARTBEAT_PERIOD = 0.05
"""Time between two heartbeats of the `network` fixture [s]."""

EVENT_TIMER = 0.005
"""Time after which each device sends its values again [s]."""

SHOWN_FRAMES = 20
"""Frames that a failed test shows."""

_OPTIONS = {
    "config": ("FILE", "the bench.toml of the bench; without it the built-in bench of one axis"),
    "interface": (
        "NAME",
        "python-can interface of a physical bench, which takes the virtual one's place",
    ),
    "channel": ("NAME", "channel of that interface"),
    "seed": ("N", "seed of all random generators of the bench"),
    "record": ("DIR", "record each test's signals and frames in a file of its own: DIR/TEST.mf4"),
}


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options, each with an ini key of its name."""
    group = parser.getgroup("hil-bench", "hil-bench: hydraulic axis behind CANopen devices")
    for name, (metavar, text) in _OPTIONS.items():
        group.addoption(f"--hil-{name}", metavar=metavar, help=text)
        parser.addini(f"hil_{name}", text)


def pytest_configure(config: pytest.Config) -> None:
    """Register the marker."""
    config.addinivalue_line(
        "markers", "hil_hardware: needs the physical bench; skipped without --hil-interface"
    )


def pytest_report_header(config: pytest.Config) -> str | None:
    """Return what the fixtures will bind, where anything of it was chosen."""
    chosen = {name: value for name in _OPTIONS if (value := _option(config, name))}
    if not chosen:
        return None
    return "hil-bench: " + ", ".join(f"{name} {value}" for name, value in chosen.items())


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Skip what needs the physical bench where there is none."""
    if _option(config, "interface"):
        return
    skip = pytest.mark.skip(reason="needs the physical bench: --hil-interface names its bus")
    for item in items:
        if item.get_closest_marker("hil_hardware"):
            item.add_marker(skip)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add the last frames of its bench to the report of a failed test."""
    report = yield
    bench = getattr(item, "funcargs", {}).get("bench")
    if not hasattr(bench, "frames"):  # the test has no bench, or another fixture of that name
        return report
    if call.when == "call" and report.failed and bench is not None:
        report.sections.append((f"last {SHOWN_FRAMES} frames on the bench's bus", _trace(bench)))
    path = _recording_path(item)
    if call.when == "call" and report.failed and path is not None and path.exists():
        report.sections.append(("recording of this test", str(path)))
    return report


@pytest.fixture(scope="session")
def hil_config(pytestconfig: pytest.Config) -> "BenchConfig":
    """The configuration of the bench, from --hil-config and --hil-seed."""
    from hil_bench.config import load_config

    seed = _option(pytestconfig, "seed")
    return load_config(_option(pytestconfig, "config"), seed=None if seed is None else int(seed))


@pytest.fixture
def bench(
    request: pytest.FixtureRequest, hil_config: "BenchConfig", pytestconfig: pytest.Config
) -> "Iterator[VirtualBench]":
    """A fresh bench in virtual time."""
    if _option(pytestconfig, "interface"):
        pytest.skip("needs the virtual bench, which --hil-interface turns off")
    from hil_bench.virtual_bench import NO_RECORDING, VirtualBench

    path = _make_recording_path(request.node)
    with VirtualBench(hil_config, record=path or NO_RECORDING) as virtual:
        yield virtual


@pytest.fixture
def faults(bench: "VirtualBench") -> "Faults":
    """What makes things go wrong on the bench: ``faults.freeze("pressure_a")``."""
    return bench.faults


@pytest.fixture
def can_bus(request: pytest.FixtureRequest, pytestconfig: pytest.Config) -> "Iterator[can.BusABC]":
    """The bus that the devices are on: of the virtual bench, or the physical one."""
    interface = _option(pytestconfig, "interface")
    if not interface:
        yield request.getfixturevalue("bench").bus
        return
    import can

    with can.Bus(interface=interface, channel=_option(pytestconfig, "channel")) as bus:
        yield bus


@pytest.fixture
def network(
    request: pytest.FixtureRequest, can_bus: "can.BusABC", pytestconfig: pytest.Config
) -> "Iterator[Network]":
    """The drivers' network on that bus, which sends a heartbeat."""
    from drivers import Network

    path = None
    if _option(pytestconfig, "interface"):
        network = Network(can_bus)
        path = _make_recording_path(request.node)
    else:
        virtual = request.getfixturevalue("bench")
        network = Network(can_bus, clock=virtual.now)
        virtual.pump = network.pump
    with network, _record_frames(network, path):
        network.start_heartbeat(CONTROLLER_ID, HEARTBEAT_PERIOD)
        yield network


@pytest.fixture
def valve(network: "Network", hil_config: "BenchConfig") -> "Iterator[ProportionalValve]":
    """The driver of the first axis' valve, ready for `enable`; disabled at the end."""
    from drivers import ProportionalValve

    node = _node(hil_config, lambda node: node.profile == "valve_408", "valve_408")
    with ProportionalValve(network, node.node_id, node.eds) as driver:
        driver.setup(
            transmission_type=254,
            event_timer=EVENT_TIMER,
            command_timeout=0.0,
            heartbeat_timeout=4 * HEARTBEAT_PERIOD,
        )
        _start(network, driver, node.node_id)
        yield driver


@pytest.fixture
def pressure(network: "Network", hil_config: "BenchConfig") -> "PressureSensor":
    """The driver of the first axis' pressure transducer at port A, sending."""
    from drivers import PressureSensor

    node = _node(hil_config, lambda node: getattr(node, "source", "") == "P_A", "pressure at P_A")
    driver = PressureSensor(network, node.node_id, node.eds)
    driver.setup(transmission_type=254, event_timer=EVENT_TIMER)
    _start(network, driver, node.node_id)
    return driver


@pytest.fixture
def position(network: "Network", hil_config: "BenchConfig") -> "PositionSensor":
    """The driver of the first axis' position sensor, sending."""
    from drivers import PositionSensor

    node = _node(hil_config, lambda node: node.profile == "encoder_406", "encoder_406")
    driver = PositionSensor(network, node.node_id, node.eds)
    driver.setup(transmission_type=254, event_timer=EVENT_TIMER)
    _start(network, driver, node.node_id)
    return driver


@contextmanager
def _record_frames(network: "Network", path: Path | None) -> Iterator[None]:
    """Record what passes a physical bus, as the drivers see it, for the time of the block.

    Yields:
        Nothing.
    """
    if path is None:
        yield
        return
    from hil_bench.recording.network_tap import NetworkTap
    from hil_bench.recording.recorder import RecordingPlan
    from hil_bench.recording.recorder_process import RecorderProcess

    with RecorderProcess(RecordingPlan((path,), ())) as recording:
        network.observe = NetworkTap(recording, network.now).observe
        yield


def _make_recording_path(item: pytest.Item) -> Path | None:
    """Return where to record a test, its folder made; None where that is not asked for."""
    path = _recording_path(item)
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
    return path


def _recording_path(item: pytest.Item) -> Path | None:
    """Return where the recording of a test is; None where none is asked for."""
    folder = _option(item.config, "record")
    if folder is None:
        return None
    return Path(folder) / f"{re.sub(r'[^A-Za-z0-9_.=-]+', '_', item.nodeid)}.mf4"


def _option(config: pytest.Config, name: str) -> str | None:
    """Return an option, else the ini key of its name, else None."""
    return config.getoption(f"hil_{name}") or config.getini(f"hil_{name}") or None


def _node(config: "BenchConfig", wanted: "Callable[[NodeConfig], bool]", what: str) -> "NodeConfig":
    """Return the node of the first axis that a fixture binds, or skip the test."""
    for node in config.nodes:
        if node.axis == config.axes[0].name and wanted(node):
            return node
    pytest.skip(f"the first axis of the bench has no {what}")


def _start(network: "Network", driver: "Device", node_id: int) -> None:
    """Bring a device to OPERATIONAL and wait for its first values."""
    network.start_node(node_id)
    network.wait_until(lambda: driver.age < 1.0, 1.0, f"{driver.node}: first values")


def _trace(bench: "VirtualBench") -> str:
    """Return the latest frames as candump shows them, marked as seen from the bench."""
    return "\n".join(
        f"({now * 1e-9:.6f}) {frame.can_id:03X}#{frame.data.hex().upper()} "
        f"{'to' if is_received else 'from'} the bench"
        for frame, now, is_received in list(bench.frames)[-SHOWN_FRAMES:]
    )
