"""The fixture `firmware`: a program on the bus of a test, and its options."""

from collections.abc import Callable, Generator, Iterator
from operator import methodcaller
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from hil_bench.abilities.common.pytest_options import add_options, option, positive_option, worker

if TYPE_CHECKING:
    from hil_bench.abilities.lockstep.firmware import Firmware, FirmwareBus
    from hil_bench.bench.virtual_bench import VirtualBench

_BUS = (
    "bus between bench and firmware: 'hub', the bench's own on 127.0.0.1 (the default), or a "
    "SocketCAN interface such as vcan0; {worker} is the number of the pytest-xdist worker"
)
_OPTIONS = {
    "firmware-bus": ("NAME", _BUS),
    "firmware-patience": (
        "S",
        "seconds without SYNC from firmware in lock-step after which its test fails (20)",
    ),
}
_REMEDY = (
    ", wait longer with --hil-firmware-patience, or let the clock move the bench with "
    "--hil-realtime"
)
_FIRMWARE_BUS: "pytest.StashKey[FirmwareBus]" = pytest.StashKey()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options, each with an ini key of its name."""
    add_options(parser, _OPTIONS)


def pytest_configure(config: pytest.Config) -> None:
    """Refuse options that cannot be meant.

    Raises:
        pytest.UsageError: workers of pytest-xdist would share one SocketCAN interface, or the
            patience is no time.
    """
    bus = option(config, "firmware-bus") or "hub"
    if bus != "hub" and "{worker}" not in bus and config.getoption("numprocesses", None):
        raise pytest.UsageError(
            f"--hil-firmware-bus {bus}: workers would share it; give vcan{{worker}}, one each"
        )
    positive_option(config, "firmware-patience")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add the state of its programs to the report of a failed test."""
    report = yield
    if call.when == "call" and report.failed and _FIRMWARE_BUS in item.stash:
        report.sections.append(("firmware", item.stash[_FIRMWARE_BUS].report()))
    return report


@pytest.fixture
def firmware(
    request: pytest.FixtureRequest,
    bench: "VirtualBench",
    hil_realtime: bool,
    tmp_path_factory: pytest.TempPathFactory,
) -> "Iterator[Callable[..., Firmware]]":
    """Starts a program on the bench's bus: ``firmware("build/controller", "--bus", "{bus}")``.

    In the arguments, ``{bus}`` becomes the bus: "vcan0", or "127.0.0.1:PORT" of the bench's own
    hub. The environment has it, too, as HIL_BENCH_BUS and in python-can's variables. From the
    first start on the program's SYNC lets bench time pass, or the clock with --hil-realtime. At the
    end of the test each program gets SIGTERM, and the bench serves it while it ends.
    """
    if option(request.config, "interface"):
        pytest.skip("firmware needs the virtual bench, which --hil-interface turns off")
    from hil_bench.abilities.controllers.process.program import USUAL_PATIENCE, Patience
    from hil_bench.abilities.lockstep.firmware import HUB, FirmwareBus
    from hil_bench.errors import HilBenchError

    longest = positive_option(request.config, "firmware-patience") or USUAL_PATIENCE.longest
    patience = Patience(longest, _REMEDY)
    name = (option(request.config, "firmware-bus") or HUB).replace("{worker}", worker())
    buses: list[FirmwareBus] = []

    def start(*command: str | Path) -> "Firmware":
        __tracebackhide__ = methodcaller("errisinstance", HilBenchError)
        if not buses:
            bus = FirmwareBus(bench, name, is_realtime=hil_realtime, patience=patience)
            buses.append(bus)
            request.node.stash[_FIRMWARE_BUS] = buses[0]
        return buses[0].start(command, tmp_path_factory.mktemp("firmware"))

    yield start
    for bus in buses:
        bus.close()
