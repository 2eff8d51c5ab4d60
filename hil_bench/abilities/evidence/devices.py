"""The checks of a pack that run the bench: conformance of its devices, and determinism."""

import hashlib
import multiprocessing
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import can

from hil_bench.abilities.conformance import report
from hil_bench.abilities.conformance.check import Impact
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.eds_check import check_eds
from hil_bench.abilities.conformance.suite import Outcome, Result, run_suite
from hil_bench.abilities.conformance.wire import Wire
from hil_bench.bench.configuration import BenchConfig, load_config
from hil_bench.canopen_device.eds import load_eds
from hil_bench.kinds.kind import NodeConfig
from hil_bench.kinds.valve_408 import ValveConfig
from hil_bench.session.virtual_bench import VirtualBench

# The conformance suite, run on each virtual CANopen device of a bench.

_PATIENCE = 0.5  # [s] of bench time, as `hil-bench conformance` has it
_UNCONFIGURED = 255


class Examination(NamedTuple):
    """The result of the suite on one device.

    Attributes:
        content: for a program.
        document: the report as Markdown; empty where the suite could not run.
    """

    content: dict[str, object]
    document: str


def examine_devices(config: BenchConfig) -> list[Examination]:
    """Run the suite on each device, each on a bench of its own, and return the results.

    The faults of the bench are left out: a broken device breaks clauses. Where a device keeps its
    parameters in a file, so are the checks that would overwrite them.
    """
    return [_examine(config.sound, node) for node in config.nodes]


def _examine(config: BenchConfig, node: NodeConfig) -> Examination:
    about = {"name": node.name, "node_id": node.node_id, "eds": node.eds.name}
    if node.node_id == _UNCONFIGURED:
        reason = "waits for LSS to give it a node-ID"
        return Examination({**about, "verdict": "not applicable", "detail": reason}, "")
    allowed = Impact.WRITE if any(each.storage for each in config.nodes) else Impact.STORE
    with VirtualBench(config) as bench:
        wire = Wire(bench.buses[node.bus], bench.now)
        objects = load_eds(node.eds, node.node_id)
        dut = DeviceUnderTest(wire, node.node_id, objects, _PATIENCE)
        results = list(run_suite(dut, allowed))
    counts = Counter(result.outcome for result in results)
    content = {
        **about,
        "verdict": "failed" if counts[Outcome.FAILED] else "passed",
        "allowed": allowed.name.lower(),
        "counts": {outcome.value: counts[outcome] for outcome in Outcome},
        "results": report.as_json(results),
    }
    return Examination(content, _document(node, results, allowed))


def _document(node: NodeConfig, results: list[Result], allowed: Impact) -> str:
    device = f"{node.name}, virtual, node {node.node_id}, {node.eds.name}"
    return report.markdown(results, device=device, allowed=allowed, eds=check_eds(node.eds))


# The same run again, in this process and in another: the same bytes?

_PERIODS = 100  # after one in which all boot
_PERIOD = 0.01  # [s]
_SETPOINTS = ((10, 0), (50, 0x2000), (60, 0), (100, -0x2000))
"""Set-point of each valve up to a period: rest, out at 50 %, stop, back."""


class Trace(NamedTuple):
    """The trace of a run.

    Attributes:
        digest: SHA-256 of all frames with their times and of all signals.
        frames: how many there were.
        rows: of the signals, a row a tick.
    """

    digest: str
    frames: int
    rows: int


def examine_determinism(config: BenchConfig) -> dict[str, object]:
    """Return the digests of three runs: two here, one in another process with its own hash seed."""
    seed, path = config.seed, config.path
    first, second = run_once(path, seed), run_once(path, seed)
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as other:
        third = other.submit(run_once, path, seed).result()
    places = ("this process", "this process, again", "another process")
    traces = (first, second, third)
    return {
        "verdict": "passed" if len(set(traces)) == 1 else "failed",
        "seed": seed,
        "length_s": _PERIODS * _PERIOD,
        "runs": [
            {"where": place, **trace._asdict()} for place, trace in zip(places, traces, strict=True)
        ],
    }


def run_once(path: Path | None, seed: int) -> Trace:
    """Run a bench for a second, its valves commanded by PDO, with a SYNC each 10 ms.

    Args:
        path: of its bench.toml; None for the built-in bench.
        seed: of all random generators.
    """
    config = load_config(path, seed=seed)
    valves = [(node.bus, node.node_id) for node in config.nodes if isinstance(node, ValveConfig)]
    with VirtualBench(config) as bench:
        bench.run(_PERIOD)  # all boot
        _send(bench.buses.values(), 0x000, b"\x01\x00")  # NMT: start all nodes
        for number in range(_PERIODS):
            setpoint = next(value for end, value in _SETPOINTS if number < end)
            command = (7).to_bytes(2, "little") + setpoint.to_bytes(2, "little", signed=True)
            for bus, node_id in valves:
                _send([bench.buses[bus]], 0x200 + node_id, command)
            _send(bench.buses.values(), 0x080, b"")  # SYNC
            bench.run(_PERIOD)
        digest = hashlib.sha256(repr([tuple(frame) for frame in bench.frames]).encode())
        digest.update(bench.signals.tobytes())
        return Trace(digest.hexdigest(), len(bench.frames), len(bench.signals))


def _send(buses: Iterable[can.BusABC], can_id: int, data: bytes) -> None:
    for bus in buses:
        bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
