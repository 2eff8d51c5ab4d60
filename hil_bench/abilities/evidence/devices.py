"""The conformance suite, run on each virtual CANopen device of a bench."""

from collections import Counter
from dataclasses import replace
from typing import NamedTuple

from hil_bench.abilities.conformance import report
from hil_bench.abilities.conformance.check import Impact
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.eds_check import check_eds
from hil_bench.abilities.conformance.suite import Outcome, Result, run_suite
from hil_bench.abilities.conformance.wire import Wire
from hil_bench.bench.configuration import BenchConfig
from hil_bench.canopen_device.eds import load_eds
from hil_bench.kinds.kind import NodeConfig
from hil_bench.session.virtual_bench import VirtualBench

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
    sound = replace(config, faults=())
    return [_examine(sound, node) for node in config.nodes]


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
