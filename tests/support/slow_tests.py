"""The tests that `-m "not slow"` leaves out: measured, not chosen.

``python tests/support/slow_tests.py`` runs the tests twice, and writes to ``tests/slow_tests.txt``
those that took the processor for `LIMIT` s or more both times, with the processes that they
started; of one with many parameters also if all together took `LIMIT_OF_ALL` s. What is done once a
process, such as an import, counts for whichever test comes first, so once is not enough.
"""

import os
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

TESTS = Path(__file__).parents[1]
LIST = TESTS / "slow_tests.txt"
LIMIT = 0.1  # s of processor time
LIMIT_OF_ALL = 0.5
RUNS = 2
FOLDER = "HIL_BENCH_TEST_TIMES"


def function_of(node_id: str) -> str:
    """Return the name of a test without its parameters."""
    return node_id.partition("[")[0]


def mark(items):
    """Mark as slow what the list names, and what needs more than this: long, a browser, a bus."""
    listed = set(LIST.read_text(encoding="utf-8").split())
    for item in items:
        needs_more = any(map(item.get_closest_marker, ("long", "browser", "hardware", "realtime")))
        if needs_more or function_of(item.nodeid) in listed:
            item.add_marker("slow")


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item):
    """Note how long a test takes, where somebody wants to know."""
    folder = os.environ.get(FOLDER)
    before = os.times() if folder else ()  # a millisecond and more on some machines
    yield
    if folder:
        taken = sum(os.times()[:4]) - sum(before[:4])
        with Path(folder, str(os.getpid())).open("a", encoding="utf-8") as file:
            file.write(f"{taken:.3f} {item.nodeid}\n")


def measure() -> dict[str, float]:
    """Run the tests, and return the processor time of each [s]."""
    with TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pytest", "-q", "-n", "auto", str(TESTS)]
        subprocess.run(command, env=os.environ | {FOLDER: folder}, check=True)  # noqa: S603 - ourselves
        lines = [line for file in Path(folder).iterdir() for line in file.read_text().splitlines()]
    return {name: float(taken) for taken, name in (line.split(" ", 1) for line in lines)}


def main() -> None:
    """Write the list."""
    runs = [measure() for _ in range(RUNS)]
    times = defaultdict(list)
    for name in runs[0]:
        times[function_of(name)].append(min(run.get(name, 0.0) for run in runs))
    slow = [
        name for name, taken in times.items() if max(taken) >= LIMIT or sum(taken) >= LIMIT_OF_ALL
    ]
    LIST.write_text("".join(f"{name}\n" for name in sorted(slow)), encoding="utf-8")
    left = sum(sum(taken) for name, taken in times.items() if name not in slow)
    sys.stdout.write(
        f"{len(slow)} of {len(times)} functions are slow; the others take {left:.0f} s\n"
    )


if __name__ == "__main__":
    main()
