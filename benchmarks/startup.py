"""Start-up: `hil-bench run` to its first boot-up frame, and what the pytest plugin costs others.

    python benchmarks/startup.py [--repeats N]

The programs join a hub of the socketcand protocol, on which this one listens: a started process is
up when its boot-up message arrives. The peer is the smallest program with the valve's EDS file on
`canopen.LocalNode`, one node without a plant. All take turns; the best counts, since other programs
only make it slower. Kernels and bytecode are cached by a first run of each, which does not count.

An unrelated pytest run has one empty test, with the plugin and with ``-p no:hil_bench``.
"""

import argparse
import contextlib
import os
import platform
import re
import resource
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from device_profiles import VALVE_408
from hil_bench.outside.transports.hub_process import HubProcess

LONGEST_START = 60.0
"""[s]"""

BOOT_UP = re.compile(rb"< frame 7[0-9A-F]{2} [0-9.]+ 00 >")

LOCAL_NODE = """
import sys, threading, can, canopen
bus = can.Bus("can0", interface="socketcand", host="127.0.0.1", port=int(sys.argv[1]))
network = canopen.Network(bus)
network.connect()
network.create_node(1, sys.argv[2]).nmt.send_command(0)
threading.Event().wait()
"""

BARE_IMPORTS = "import can, canopen, numba"

PLUGIN_IMPORT = """
import time, pytest
started = time.process_time()
import hil_bench.pytest_plugin
print(time.process_time() - started)
"""


class Cost(NamedTuple):
    """What it took: on the clock, and of the processor (its children included) [s]."""

    wall: float
    processor: float


def join(port: int) -> socket.socket:
    """Return a connection that hears every frame of the hub's bus."""
    connection = socket.create_connection(("127.0.0.1", port), timeout=LONGEST_START)
    for command in (b"< open can0 >", b"< rawmode >"):
        connection.recv(100)
        connection.sendall(command)
    connection.recv(100)
    return connection


def measure_boot(command: list[str], port: int) -> Cost:
    """Return the cost from the start of a program to its first boot-up frame."""
    with join(port) as bus:
        started = time.perf_counter()
        process = subprocess.Popen(  # noqa: S603 - our own
            command, stdout=subprocess.DEVNULL, start_new_session=True
        )
        heard = b""
        try:
            while not BOOT_UP.search(heard):
                heard += bus.recv(4096)
            wall = time.perf_counter() - started
            processor = processor_time(process.pid)
        finally:
            process.terminate()
            process.wait()
    return Cost(wall, processor)


def processor_time(pid: int) -> float:
    """Return what a process has used of the processor so far, where /proc tells [s]."""
    with contextlib.suppress(OSError):
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(") ")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return float("nan")


def measure_run(command: list[str], directory: Path) -> Cost:
    """Return the cost of a program that ends by itself."""
    before, started = children_time(), time.perf_counter()
    subprocess.run(  # noqa: S603 - our own
        command, check=True, stdout=subprocess.DEVNULL, cwd=directory
    )
    return Cost(time.perf_counter() - started, children_time() - before)


def children_time() -> float:
    """Return what ended children have used of the processor [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def boot_commands(port: int) -> dict[str, list[str]]:
    """Return the programs that boot, by name."""
    run = [sys.executable, "-m", "hil_bench", "-q", "run", "-i", "socketcand", "-c", "can0"]
    peer = [sys.executable, "-c", LOCAL_NODE, str(port), str(VALVE_408)]
    return {
        "hil-bench run": [*run, "--bus-kwargs", "host=127.0.0.1", f"port={port}"],
        "canopen.LocalNode": peer,
    }


def print_boot(repeats: int, directory: Path) -> None:
    """Print the table of starts."""
    with HubProcess(port=0) as hub:
        commands = boot_commands(hub.port)
        costs: dict[str, list[Cost]] = {name: [] for name in commands}
        imports = [sys.executable, "-c", BARE_IMPORTS]
        costs[BARE_IMPORTS] = []
        for _ in range(repeats + 1):
            for name, command in commands.items():
                costs[name].append(measure_boot(command, hub.port))
            costs[BARE_IMPORTS].append(measure_run(imports, directory))
    best = {name: Cost(*map(min, zip(*taken[1:], strict=True))) for name, taken in costs.items()}
    peer = best["canopen.LocalNode"].wall
    print("| to the first boot-up frame | wall s | processor s | wall over the peer's |")
    print("|---|---|---|---|")
    for name, (wall, processor) in best.items():
        print(f"| {name} | {wall:.2f} | {processor:.2f} | {wall / peer:.2f} |")


def print_plugin(repeats: int, directory: Path) -> None:
    """Print what the plugin adds to a pytest run that has nothing to do with it."""
    (directory / "test_nothing.py").write_text("def test_nothing():\n    pass\n", encoding="utf-8")
    run = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    without, plain = [], []
    for _ in range(repeats + 1):
        without.append(measure_run([*run, "-p", "no:hil_bench"], directory).processor)
        plain.append(measure_run(run, directory).processor)
    imports = [measure_import() for _ in range(repeats)]
    print("\n| unrelated pytest run, processor ms | best | median |\n|---|---|---|")
    for name, taken in (
        ("without the plugin", without[1:]),
        ("with it", plain[1:]),
        ("import of the plugin alone, after pytest's", imports),
    ):
        print(f"| {name} | {min(taken) * 1e3:.1f} | {statistics.median(taken) * 1e3:.1f} |")


def measure_import() -> float:
    """Return what the import of the plugin takes of the processor where pytest is there [s]."""
    command = [sys.executable, "-c", PLUGIN_IMPORT]
    return float(subprocess.run(command, check=True, capture_output=True).stdout)  # noqa: S603 - ours


def main() -> None:
    """Print the figures as Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=10)
    args = parser.parse_args()
    print(f"{platform.machine()}, Python {platform.python_version()}, best of {args.repeats}\n")
    with tempfile.TemporaryDirectory() as name:
        print_boot(args.repeats, Path(name))
        print_plugin(args.repeats, Path(name))


if __name__ == "__main__":
    main()
