"""Run every benchmark for a moment, as the gate does: ``python benchmarks/brief.py [NAME ...]``.

A benchmark fails where it does not end with 0, prints a traceback or has no ``--brief``, and this
program fails with it. Figures of such a run mean nothing; that each part still runs is the point.
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

HERE: Final = Path(__file__).parent

PARTS: Final = frozenset(
    {
        "brief",
        "eyes_corpus",
        "linear_models",
        "manoeuvres",
        "master",
        "mutants",
        "mutation_tests",
        "occasion",
        "peers",
        "plain_fit",
        "responders",
        "stranger_prediction",
    }
)
"""Modules of the programs, which do nothing by themselves."""

PATIENCE: Final = 600.0  # [s]


def programs() -> list[str]:
    """Return the names of all benchmarks."""
    return sorted(path.stem for path in HERE.glob("*.py") if path.stem not in PARTS)


def run(name: str) -> str:
    """Run a benchmark for a moment; return why it failed, or nothing."""
    command = [sys.executable, str(HERE / f"{name}.py"), "--brief"]
    try:
        done = subprocess.run(  # noqa: S603 - our own programs
            command, capture_output=True, text=True, check=False, timeout=PATIENCE
        )
    except subprocess.TimeoutExpired:
        return f"not through after {PATIENCE:g} s"
    if done.returncode:
        return f"exit code {done.returncode}\n{done.stdout}{done.stderr}"
    if "--brief" not in done.stdout:
        return f"it does not say that it was brief\n{done.stdout}{done.stderr}"
    if "Traceback (most recent call last)" in done.stderr:
        return f"a part of it failed\n{done.stderr}"
    return ""


def main() -> int:
    """Print a line for each benchmark; return 1 where one failed."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", choices=[[], *programs()])
    failed = []
    for name in parser.parse_args().names or programs():
        begin = time.monotonic()
        reason = run(name)
        verdict = f"FAILED: {reason}" if reason else "ran"
        print(f"{name:24} {time.monotonic() - begin:5.1f} s  {verdict}", flush=True)
        failed += [name] if reason else []
    print(f"{len(failed)} failed: {', '.join(failed)}" if failed else "all of them ran")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
