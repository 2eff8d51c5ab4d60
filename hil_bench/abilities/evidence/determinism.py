"""The same run again, in this process and in another: the same bytes?"""

import hashlib
import multiprocessing
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import can

from hil_bench.bench.configuration import BenchConfig, load_config
from hil_bench.kinds.valve_408 import ValveConfig
from hil_bench.session.virtual_bench import VirtualBench

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
