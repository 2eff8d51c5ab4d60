"""Start-up: what a verb costs before its work, `hil-bench run` to its first boot-up, the plugin.

    python benchmarks/startup.py [--repeats N] [--only verbs|boot|plugin] [--against CHECKOUT]

The verbs of the first table run to their end, `scan` to the first frame that it sends; `run` of
the second runs to its boot-up message. For these this program listens on a hub of the socketcand
protocol. The peer of `run` is the smallest program with the valve's EDS file on
`canopen.LocalNode`, one node without a plant. All take turns, those of another checkout too.
Kernels and bytecode are cached by a first turn, which does not count, whatever
PYTHONDONTWRITEBYTECODE says.

An unrelated pytest run has one empty test, with the plugin and with ``-p no:hil_bench``.
"""

import argparse
import os
import re
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import occasion
from device_profiles import VALVE_408
from hil_bench.abilities.hub.process import HubProcess

LONGEST_START = 300.0
"""The first one compiles [s]."""

BOOT_UP = re.compile(rb"< frame 7[0-9A-F]{2} [0-9.]+ 00 >")
ANY_FRAME = re.compile(rb"< frame ")

VERBS = ("--help", "--version", "check", "devices", "registers", "completion bash")
"""They end by themselves and need no bus."""

LOCAL_NODE = """
import sys, threading, can, canopen
bus = can.Bus("can0", interface="socketcand", host="127.0.0.1", port=int(sys.argv[1]))
network = canopen.Network(bus)
network.connect()
network.create_node(1, sys.argv[2]).nmt.send_command(0)
threading.Event().wait()
"""

NOTHING = "python -c pass"

PLUGIN_IMPORT = """
import time, pytest
started = time.process_time()
import hil_bench.pytest_plugin
from hil_bench.ability import own_abilities
for place in filter(None, (ability.fixtures for ability in own_abilities())):
    __import__(place)
print(time.process_time() - started)
"""

Turn = Callable[[], "Cost"]


class Cost(NamedTuple):
    """The cost in time: on the clock, and of the processor [s]."""

    wall: float
    processor: float


def environment(checkout: Path | None = None) -> dict[str, str]:
    """Return the environment of a measured program, which imports from `checkout` if given."""
    kept = {name: text for name, text in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    if checkout is not None:
        kept["PYTHONPATH"] = os.pathsep.join((str(checkout), str(checkout / "drivers")))
    return kept


def join(port: int) -> socket.socket:
    """Return a connection that hears every frame of the hub's bus."""
    connection = socket.create_connection(("127.0.0.1", port), timeout=LONGEST_START)
    for command in (b"< open can0 >", b"< rawmode >"):
        connection.recv(100)
        connection.sendall(command)
    connection.recv(100)
    return connection


def until_heard(
    command: list[str], port: int, awaited: re.Pattern[bytes], checkout: Path | None
) -> Cost:
    """Return the cost from the start of a program to a frame of it."""
    with join(port) as bus:
        started = time.perf_counter()
        process = subprocess.Popen(  # noqa: S603 - our own
            command,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            env=environment(checkout),
        )
        heard = b""
        try:
            while not awaited.search(heard):
                heard += bus.recv(4096)
            wall = time.perf_counter() - started
            processor = processor_time(process.pid)
        finally:
            process.terminate()
            process.wait()
    return Cost(wall, processor)


def processor_time(pid: int) -> float:
    """Return the processor time of the threads of a process [s]; NaN if unknown."""
    tasks = Path(f"/proc/{pid}/task").glob("*/schedstat")
    times = [int(task.read_text(encoding="ascii").split()[0]) for task in tasks]
    return sum(times) * 1e-9 if times else float("nan")


def until_ended(
    command: list[str], *, directory: Path | None = None, checkout: Path | None = None
) -> Cost:
    """Return the cost of a program that ends by itself.

    Raises:
        CalledProcessError: it failed.
    """
    started = time.perf_counter()
    process = subprocess.Popen(  # noqa: S603 - our own
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        cwd=directory,
        env=environment(checkout),
    )
    _, status, used = os.wait4(process.pid, 0)
    wall = time.perf_counter() - started
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return Cost(wall, used.ru_utime + used.ru_stime)


def hil_bench(words: str) -> list[str]:
    """Return the command of a verb; -P, lest the checkout that this is started in comes first."""
    return [sys.executable, "-P", "-m", "hil_bench", *words.split()]


def on_hub(port: int) -> str:
    """Return the words that have a verb join the hub."""
    return f"-i socketcand -c can0 --bus-kwargs host=127.0.0.1 port={port}"


def take_turns(turns: Mapping[str, Turn], repeats: int) -> dict[str, list[Cost]]:
    """Return the costs of all programs, measured in turns; the first turn does not count."""
    costs: dict[str, list[Cost]] = {name: [] for name in turns}
    for _ in range(repeats + 1):
        for name, turn in turns.items():
            costs[name].append(turn())
    return {name: taken[1:] for name, taken in costs.items()}


def print_verbs(repeats: int, checkouts: Mapping[str, Path | None]) -> None:
    """Print the table of verbs."""
    with HubProcess(port=0) as hub:
        turns: dict[str, Turn] = {NOTHING: lambda: until_ended([sys.executable, "-c", "pass"])}
        for label, checkout in checkouts.items():
            for verb in VERBS:
                command = hil_bench(verb)
                turns[f"hil-bench {verb}{label}"] = lambda command=command, checkout=checkout: (
                    until_ended(command, checkout=checkout)
                )
            scan = hil_bench(f"scan {on_hub(hub.port)}")
            turns[f"hil-bench scan, to its first frame{label}"] = (
                lambda scan=scan, checkout=checkout: until_heard(
                    scan, hub.port, ANY_FRAME, checkout
                )
            )
        costs = take_turns(turns, repeats)
    print("| | processor ms, best | median |\n|---|---|---|")
    for name, taken in costs.items():
        times = [cost.processor * 1e3 for cost in taken]
        print(f"| `{name}` | {min(times):.0f} | {statistics.median(times):.0f} |")


def print_boot(repeats: int, checkouts: Mapping[str, Path | None]) -> None:
    """Print the table of starts."""
    with HubProcess(port=0) as hub:
        turns: dict[str, Turn] = {}
        for label, checkout in checkouts.items():
            run = hil_bench(f"-q run {on_hub(hub.port)}")
            turns[f"hil-bench run{label}"] = lambda run=run, checkout=checkout: until_heard(
                run, hub.port, BOOT_UP, checkout
            )
        peer = [sys.executable, "-c", LOCAL_NODE, str(hub.port), str(VALVE_408)]
        turns["canopen.LocalNode"] = lambda: until_heard(peer, hub.port, BOOT_UP, None)
        for library in ("can, canopen", "numpy", "numba"):
            imports = [sys.executable, "-c", f"import {library}"]
            turns[f"import {library}"] = lambda imports=imports: until_ended(imports)
        costs = take_turns(turns, repeats)
    print("\n| to the first boot-up frame | wall s, best | processor s, best | median |")
    print("|---|---|---|---|")
    for name, taken in costs.items():
        wall, processor = map(min, zip(*taken, strict=True))
        median = statistics.median(cost.processor for cost in taken)
        print(f"| `{name}` | {wall:.2f} | {processor:.2f} | {median:.2f} |")


def print_plugin(repeats: int) -> None:
    """Print what the plugin adds to a pytest run that has nothing to do with it."""
    run = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        empty = "def test_nothing():\n    pass\n"
        (directory / "test_nothing.py").write_text(empty, encoding="utf-8")
        turns: dict[str, Turn] = {
            "without the plugin": lambda: until_ended(
                [*run, "-p", "no:hil_bench"], directory=directory
            ),
            "with it": lambda: until_ended(run, directory=directory),
            "import of the plugin alone, after pytest's": measure_import,
        }
        costs = take_turns(turns, repeats)
    print("\n| unrelated pytest run, processor ms | best | median |\n|---|---|---|")
    for name, taken in costs.items():
        times = [cost.processor * 1e3 for cost in taken]
        print(f"| {name} | {min(times):.1f} | {statistics.median(times):.1f} |")


def measure_import() -> Cost:
    """Measure the processor time of the plugin's import where pytest is there."""
    command = [sys.executable, "-c", PLUGIN_IMPORT]
    done = subprocess.run(command, check=True, capture_output=True, env=environment())  # noqa: S603 - ours
    return Cost(float("nan"), float(done.stdout))


def main() -> None:
    """Print the figures as Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=10)
    parser.add_argument("--only", choices=("verbs", "boot", "plugin"))
    parser.add_argument(
        "--against", type=Path, metavar="CHECKOUT", help="another checkout, measured in turns"
    )
    args = occasion.arguments(parser, repeats=1)
    print(f"{args.repeats} turns\n")
    here = Path(__file__).parents[1]
    checkouts: dict[str, Path | None] = {"": here}
    if args.against is not None:
        checkouts[f" of {args.against.name}"] = args.against.resolve()
    if args.only in {None, "verbs"}:
        print_verbs(args.repeats, checkouts)
    if args.only in {None, "boot"}:
        print_boot(args.repeats, checkouts)
    if args.only in {None, "plugin"}:
        print_plugin(args.repeats)


if __name__ == "__main__":
    main()
