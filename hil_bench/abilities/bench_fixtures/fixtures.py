"""Fixtures for tests of a controller against the bench, on the virtual or on the physical bus.

    def test_holds_position(bench, valve, position):
        valve.enable()
        valve.spool_setpoint = 0.4
        bench.run_until(lambda: position.position > 0.05, timeout=2.0)

Every test gets a fresh bench in virtual time. With ``--hil-interface`` the fixtures `can_bus`,
`network`, `valve`, `pressure` and `position` bind the physical bus instead, and a test that looks
into `bench` is skipped.

The module loads in every pytest run of its environment, so it imports nothing of weight before a
fixture asks.
"""

from collections.abc import Callable, Generator, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, cast

import pytest

from hil_bench.abilities.common import pytest_options as options
from hil_bench.abilities.common.pytest_options import BENCH

if TYPE_CHECKING:
    import can

    from hil_bench.abilities.bench_fixtures.devices import Devices, Networks, PhysicalBench
    from hil_bench.bench.configuration import BenchConfig, NodeConfig
    from hil_bench.bench.virtual_bench import VirtualBench
    from hil_drivers import Network, PositionSensor, PressureSensor, ProportionalValve

_OPTIONS = {
    "config": ("FILE", "the bench.toml of the bench; without it the built-in bench of one axis"),
    "interface": (
        "NAME",
        "python-can interface of a physical bench, which takes the virtual one's place",
    ),
    "channel": ("NAME", "channel of that interface"),
    "seed": ("N", "seed of all random generators of the bench"),
    "artifacts": ("DIR", "where failed tests leave trace, signals and plot (pytest's tmp_path)"),
}

_SWITCHES = {
    "realtime": "let bench time pass with the clock, as with hardware",
}
_ARTIFACTS: "pytest.StashKey[Callable[[], Path]]" = pytest.StashKey()
_BROKEN: "pytest.StashKey[str]" = pytest.StashKey()
_CONFIG: "pytest.StashKey[BenchConfig]" = pytest.StashKey()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options, each with an ini key of its name."""
    options.add_options(parser, _OPTIONS, _SWITCHES)


def pytest_configure(config: pytest.Config) -> None:
    """Register the markers, and read the bench that the options name."""
    config.addinivalue_line(
        "markers",
        "hil(**tables): tables of bench.toml for one test, over those of --hil-config: "
        "hil(plant={'axis1': {'moving_mass_kg': 50}})",
    )
    config.addinivalue_line(
        "markers", "hil_hardware: needs the physical bench; skipped without --hil-interface"
    )
    config.addinivalue_line(
        "markers",
        "hil_requires(profile, ..., axes=1): needs nodes of these profiles on the first axis, and "
        "as many axes; skipped on a bench without",
    )
    options.seed_option(config)  # here, as in a test it would be a failure
    if options.path_option(config, "config"):
        config.stash[_CONFIG] = _load_config(config)
        _warn_of_a_moved_rootdir(config)


def _load_config(config: pytest.Config) -> "BenchConfig":
    """Return the bench that the options name.

    Raises:
        pytest.UsageError: there is none, or it is wrong.
    """
    from hil_bench.bench.configuration import load_config
    from hil_bench.errors import ConfigError

    path = config.getoption("hil_config") or options.path_option(config, "config")
    try:
        return load_config(path, seed=options.seed_option(config))
    except ConfigError as error:
        raise pytest.UsageError(f"--hil-config: {error}") from None


def _warn_of_a_moved_rootdir(config: pytest.Config) -> None:
    """Say so where pytest has taken the file of ``--hil-config FILE`` for one of its tests.

    It looks for its ini file before it knows the options of plugins, above all that might be a
    path.
    """
    given = config.invocation_params
    if "--hil-config" in given.args and config.inipath is None and config.rootpath != given.dir:
        path = config.getoption("hil_config")
        config.issue_config_time_warning(
            pytest.PytestConfigWarning(
                f"rootdir is {config.rootpath}: pytest counts the file of --hil-config among its "
                f"tests; write --hil-config={path}"
            ),
            stacklevel=2,
        )


def pytest_collect_file(parent: pytest.Collector, file_path: Path) -> pytest.Collector | None:
    """Make tests of a file where an ability takes those of its name."""
    from hil_bench.ability import load, own_abilities

    for ability in own_abilities():
        for ending, place in ability.collectors.items():
            if file_path.name.endswith(ending):
                kind = cast("type[pytest.File]", load(place))
                collector: pytest.Collector = kind.from_parent(parent, path=file_path)
                return collector
    return None


def pytest_report_header(config: pytest.Config) -> str | None:
    """Return the chosen options and the versions for the header; None without chosen options."""
    chosen = options.chosen_options(config)
    return f"hil-bench: {chosen}; {options.versions()}" if chosen else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Skip what needs the physical bench where there is none, and what needs another bench."""
    for item in items:
        if item.get_closest_marker("hil_requires"):
            item.fixturenames.append("_hil_requirements")  # type: ignore[attr-defined]
    if options.option(config, "interface"):
        return
    skip = pytest.mark.skip(reason="needs the physical bench: --hil-interface names its bus")
    for item in items:
        if item.get_closest_marker("hil_hardware"):
            item.add_marker(skip)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add the last frames of its bench to the report of a failed test, and name its files."""
    report = yield
    bench = item.stash.get(BENCH, None)
    if bench is not None and call.when == "call" and report.failed:
        from hil_bench.abilities.bench_fixtures.failure_report import attach_files, describe_bench

        report.sections += describe_bench(bench)
        attach_files(item, bench, item.stash[_ARTIFACTS], report)
    return report


@pytest.fixture(scope="session")
def hil_config(pytestconfig: pytest.Config) -> "BenchConfig":
    """The configuration of the bench, from --hil-config and --hil-seed."""
    if _CONFIG not in pytestconfig.stash:
        pytestconfig.stash[_CONFIG] = _load_config(pytestconfig)
    return pytestconfig.stash[_CONFIG]


@pytest.fixture
def _bench_config(request: pytest.FixtureRequest, hil_config: "BenchConfig") -> "BenchConfig":
    """The configuration of the bench of one test: with the tables of its `hil` markers."""
    markers = list(request.node.iter_markers("hil"))
    if not markers:
        return hil_config
    if options.option(request.config, "interface"):
        pytest.skip("@pytest.mark.hil needs the virtual bench, which --hil-interface turns off")
    from hil_bench.bench.configuration import load_config
    from hil_bench.config.document import merge
    from hil_bench.errors import ConfigError

    tables: Mapping[str, object] = {}
    for marker in reversed(markers):  # the closest one last, so that it wins
        if marker.args:
            pytest.fail(f"@pytest.mark.hil takes tables by name, not {marker.args[0]!r}")
        tables = merge(tables, marker.kwargs)
    try:
        return load_config(hil_config.path, seed=hil_config.seed, tables=tables)
    except ConfigError as error:
        problem = str(error)
    pytest.fail(f"@pytest.mark.hil: {problem}", pytrace=False)


@pytest.fixture
def bench(
    request: pytest.FixtureRequest,
    _bench_config: "BenchConfig",
    hil_realtime: bool,
    tmp_path_factory: pytest.TempPathFactory,
) -> "Iterator[VirtualBench | PhysicalBench]":
    """A fresh bench in virtual time; in real time with --hil-realtime, or on a physical bus."""
    request.node.user_properties.extend(_properties(request.config, _bench_config))
    if options.option(request.config, "interface"):
        from hil_bench.abilities.bench_fixtures.devices import PhysicalBench

        yield PhysicalBench(_bench_config)
        return
    from hil_bench.ability import given_to
    from hil_bench.bench.virtual_bench import VirtualBench
    from hil_bench.outside.realtime.clock import MonotonicClock
    from hil_bench.outside.realtime.pacer import Pacer

    directory = options.path_option(request.config, "artifacts")
    request.node.stash[_ARTIFACTS] = lambda: directory or tmp_path_factory.mktemp("hil-bench")
    pacer = Pacer(MonotonicClock(), _bench_config.tick_ns) if hil_realtime else None
    recorder = next(iter(given_to("pytest")), None)
    path = None if recorder is None else recorder.make_recording_path(request.node)
    with VirtualBench(_bench_config, pacer=pacer, record=path) as virtual:
        request.node.stash[BENCH] = virtual
        yield virtual
    if recorder is not None:
        recorder.check_recorded(virtual.recording)


@pytest.fixture(scope="session")
def hil_realtime(pytestconfig: pytest.Config) -> bool:
    """Return True if bench time passes with the clock: --hil-realtime, or a physical bus."""
    return (
        options.is_on(pytestconfig, "realtime")
        or options.option(pytestconfig, "interface") is not None
    )


@pytest.fixture
def can_bus(request: pytest.FixtureRequest, pytestconfig: pytest.Config) -> "Iterator[can.BusABC]":
    """The bus that the devices are on: of the virtual bench, or the physical one.

    Raises:
        BusError: the physical one cannot be opened; later tests are then skipped.
    """
    interface = options.option(pytestconfig, "interface")
    if not interface:
        yield request.getfixturevalue("bench").bus
        return
    if cause := pytestconfig.stash.get(_BROKEN, None):
        pytest.skip(f"the bench's bus broke before: {cause}")
    from hil_bench.errors import BusError
    from hil_bench.outside.transports.opening import open_can_bus

    try:
        bus, _ = open_can_bus(interface, options.option(pytestconfig, "channel"), None, {})
    except BusError as error:
        pytestconfig.stash[_BROKEN] = str(error)
        raise
    with bus:
        yield bus


@pytest.fixture
def network(
    request: pytest.FixtureRequest, can_bus: "can.BusABC", pytestconfig: pytest.Config
) -> "Iterator[Network]":
    """The drivers' network on that bus, which sends a heartbeat; virtual devices have booted."""
    from contextlib import ExitStack

    from hil_bench.abilities.bench_fixtures.devices import hide_drivers_from_tracebacks
    from hil_bench.ability import given_to
    from hil_drivers import Network

    hide_drivers_from_tracebacks()
    bench = request.getfixturevalue("bench")
    is_physical = bool(options.option(pytestconfig, "interface"))
    network = Network(can_bus) if is_physical else Network(can_bus, clock=bench.now)
    bench.pump = network.pump
    with ExitStack() as stack:
        stack.enter_context(network)
        for module in given_to("pytest") if is_physical else ():
            stack.enter_context(module.record_frames(network, request.node))
        if not is_physical and bench.now() == 0.0:
            network.pump(bench.config.tick_ns * 1e-9)  # the devices boot
        network.start_heartbeat()
        yield network


@pytest.fixture
def _networks(
    request: pytest.FixtureRequest, network: "Network", _bench_config: "BenchConfig"
) -> "Iterator[Networks]":
    """The networks of all buses, that of the first among them, pumped together."""
    from contextlib import ExitStack

    from hil_bench.abilities.bench_fixtures.devices import Networks
    from hil_bench.outside.transports.opening import open_can_bus
    from hil_drivers import Network

    bench = request.getfixturevalue("bench")
    with ExitStack() as stack:

        def make(name: str) -> Network:
            if options.option(request.config, "interface"):
                bus = _bench_config.buses[name]
                settings = (bus.interface, bus.channel, bus.bitrate, bus.options)
                made = Network(stack.enter_context(open_can_bus(*settings)[0]))
            else:
                made = Network(bench.buses[name], clock=bench.now)
            stack.enter_context(made)
            made.start_heartbeat()
            return made

        first = next(iter(_bench_config.buses))
        networks = Networks(first, network, make, _bench_config.tick_ns * 1e-9)
        bench.pump = networks.pump
        yield networks


@pytest.fixture
def device(_networks: "Networks", _bench_config: "BenchConfig") -> "Iterator[Devices]":
    """The driver of any node by its name, set up and sending: ``device("pressure_b")``."""
    from contextlib import ExitStack

    from hil_bench.abilities.bench_fixtures.devices import Devices

    with ExitStack() as stack:
        yield Devices(_bench_config, _networks, stack)


@pytest.fixture
def valve(request: pytest.FixtureRequest, _bench_config: "BenchConfig") -> "ProportionalValve":
    """The driver of the first axis' valve, ready for `enable`; disabled at the end."""
    from hil_bench.devices.kinds.registry import VALVE

    node = _node(_bench_config, lambda node: node.kind is VALVE, VALVE.name)
    driver: ProportionalValve = request.getfixturevalue("device")(node.name)
    return driver


@pytest.fixture
def pressure(request: pytest.FixtureRequest, _bench_config: "BenchConfig") -> "PressureSensor":
    """The driver of the first axis' pressure transducer at port A, sending."""
    from hil_bench.plants.hydraulic_cylinder.quantities import P_A

    node = _node(_bench_config, lambda node: node.kind.measured(node) == P_A, f"pressure at {P_A}")
    driver: PressureSensor = request.getfixturevalue("device")(node.name)
    return driver


@pytest.fixture
def position(request: pytest.FixtureRequest, _bench_config: "BenchConfig") -> "PositionSensor":
    """The driver of the first axis' position sensor, sending."""
    from hil_bench.devices.kinds.registry import ENCODER

    node = _node(_bench_config, lambda node: node.kind is ENCODER, ENCODER.name)
    driver: PositionSensor = request.getfixturevalue("device")(node.name)
    return driver


@pytest.fixture
def _hil_requirements(request: pytest.FixtureRequest, _bench_config: "BenchConfig") -> None:
    """Skips a test whose `hil_requires` marker the bench does not meet."""
    for marker in request.node.iter_markers("hil_requires"):
        axes = marker.kwargs.get("axes", 1)
        if len(_bench_config.axes) < axes:
            pytest.skip(f"needs a bench of {axes} axes; this one has {len(_bench_config.axes)}")
        for profile in marker.args:
            _node(_bench_config, partial(_is_of, profile), profile)


def _is_of(profile: str, node: "NodeConfig") -> bool:
    return node.profile == profile


def _node(config: "BenchConfig", wanted: "Callable[[NodeConfig], bool]", what: str) -> "NodeConfig":
    """Return the node of the first axis that a fixture binds, or skip the test."""
    for node in config.nodes:
        if config.axes and node.axis == config.axes[0].name and wanted(node):
            return node
    pytest.skip(f"the first axis of the bench has no {what}")


def _properties(config: pytest.Config, bench: "BenchConfig") -> list[tuple[str, object]]:
    """List the properties of a test's bench for a JUnit file."""
    bus = [options.option(config, name) for name in ("interface", "channel")]
    return [
        ("hil_config", options.shown_path(config, bench.path) if bench.path else "built-in bench"),
        ("hil_seed", bench.seed),
        ("hil_interface", " ".join(filter(None, bus)) or "virtual bench"),
        ("hil_versions", options.versions()),
    ]
