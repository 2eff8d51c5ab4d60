"""Check that the same configuration and seed give the same bytes, run after run.

    python benchmarks/determinism.py [--runs N] [--bus hub|vcan0]

Each run is a new process with another PYTHONHASHSEED. In process: `hil-bench demo --speed max`, its
bus log and its signals. In lock-step: `hil-bench run --lockstep --record` with the controller in C
of examples/firmware as a second process, on the bench's own hub or on a SocketCAN interface.
"""

import argparse
import hashlib
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import occasion

ROOT = Path(__file__).parents[1]
HIL_BENCH = [sys.executable, "-m", "hil_bench"]


def environment(number: int) -> dict[str, str]:
    """Return this process's environment with a hash seed of its own."""
    return os.environ | {"PYTHONHASHSEED": str(number)}


def digest(*paths: Path) -> str:
    """Return the SHA-256 of what the files hold."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()


def run_demo(directory: Path, number: int) -> str:
    """Return the digest of what one demo in virtual time left behind."""
    command = [*HIL_BENCH, "-q", "demo", "--speed", "max", "--duration", "2"]
    subprocess.run(  # noqa: S603 - our own program
        [*command, "--output", directory],
        env=environment(number),
        check=True,
        stdout=subprocess.DEVNULL,
    )
    return digest(directory / "demo.log", directory / "demo.csv")


def run_lockstep(directory: Path, number: int, controller: Path, bus: str) -> str:
    """Return the digest of the trace of one session of bench and controller."""
    trace = directory / "trace.log"
    where = ["--hub", "0"] if bus == "hub" else ["-i", "socketcan", "-c", bus]
    command = [*HIL_BENCH, "run", "--lockstep", *where, "--record", str(trace)]
    with subprocess.Popen(  # noqa: S603 - our own program
        command, env=environment(number), stdout=subprocess.PIPE, text=True
    ) as bench:
        address = read_address(iter(bench.stdout or ()), bus)
        session = ["--bus", address, "--lockstep", "--targets-mm", "30,-10"]
        subprocess.run(  # noqa: S603 - our own program
            [controller, *session], check=True, stdout=subprocess.DEVNULL
        )
        bench.send_signal(signal.SIGINT)
        bench.communicate()
    return digest(trace)


def read_address(lines: Iterator[str], bus: str) -> str:
    """Return the bus for the controller, once the bench has told that it is there."""
    address = bus
    for line in lines:
        if found := re.search(r"host=(\S+) port=(\d+)", line):
            address = ":".join(found.groups())
        if line.startswith("node 4"):
            break
    return address


def main() -> None:
    """Print the figures as a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--bus", default="hub", help="hub, or a SocketCAN interface")
    args = occasion.arguments(parser, runs=2)
    print("| | runs | different traces |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        demos = {run_demo(directory, number) for number in range(args.runs)}
        print(f"| in process, `demo --speed max` | {args.runs} | {len(demos)} |", flush=True)
        make = ["make", "--silent", "-C", ROOT / "examples" / "firmware", f"BUILD={directory}"]
        subprocess.run(make, check=True)  # noqa: S603 - our own Makefile
        controller = directory / "position_control"
        traces = {
            run_lockstep(directory, number, controller, args.bus) for number in range(args.runs)
        }
        print(f"| lock-step, two processes on {args.bus} | {args.runs} | {len(traces)} |")
    sys.exit(len(demos) > 1 or len(traces) > 1)


if __name__ == "__main__":
    main()
