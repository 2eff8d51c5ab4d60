"""The occasion of a figure: commit, day, machine and load; and the arguments of a benchmark.

Every program here takes its arguments by `arguments`, so that each has ``--brief``: a moment's run
of each of its parts, which the gate does (`benchmarks/brief.py`). A part that did not run ends the
program: `missing` says which and why, `joined` looks at how a process ended.
"""

import argparse
import datetime as dt
import os
import platform
import subprocess
import sys
from multiprocessing.context import SpawnProcess
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import NoReturn

ROOT = Path(__file__).parents[1]


def arguments(parser: argparse.ArgumentParser, **brief: object) -> argparse.Namespace:
    """Parse the command line and print the occasion.

    Args:
        parser: with the program's own options.
        brief: the defaults that ``--brief`` has in place of the parser's.
    """
    parsed = quiet_arguments(parser, **brief)
    print_occasion(parsed)
    return parsed


def quiet_arguments(parser: argparse.ArgumentParser, **brief: object) -> argparse.Namespace:
    """Parse the command line and print nothing, for a program that starts itself again."""
    parser.add_argument(
        "--brief", action="store_true", help="run each part for a moment; the figures mean nothing"
    )
    if "--brief" in sys.argv[1:]:
        parser.set_defaults(**brief)
    return parser.parse_args()


def print_occasion(parsed: argparse.Namespace) -> None:
    """Print when, at which commit and on what the figures that follow are taken."""
    today = dt.datetime.now(tz=dt.UTC).date()
    print(
        f"{today}, commit {commit()}; {machine()}, Linux {platform.release()}, "
        f"Python {platform.python_version()}, load {os.getloadavg()[0]:.1f} before"
    )
    if parsed.brief:
        print("--brief: every part ran for a moment only; these are no figures to quote")
    print(flush=True)


def commit() -> str:
    """Return the commit of this tree, with "-dirty" where files differ from it."""
    command = ["git", "-C", str(ROOT), "describe", "--always", "--dirty", "--exclude", "*"]
    found = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - fixed
    return found.stdout.strip() or "unknown (no git checkout)"


def machine() -> str:
    """Return the processors of this machine: how many and which."""
    text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    names = [line.partition(":")[2].strip() for line in text.splitlines() if "model name" in line]
    return f"{os.cpu_count()} x {names[0] if names else platform.machine()}"


def missing(part: str, reason: str) -> NoReturn:
    """End the program: a part of it did not run."""
    sys.exit(f"{Path(sys.argv[0]).name}: {part} did not run: {reason}")


def joined(process: BaseProcess | SpawnProcess, part: str) -> None:
    """Wait for a process and end the program where it failed."""
    process.join()
    if process.exitcode:
        missing(part, f"its process ended with {process.exitcode}; its traceback is above")
