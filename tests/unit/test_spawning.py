"""A process that shares the terminal does not hear its Ctrl-C."""

import multiprocessing
import re
import signal
import sys
from pathlib import Path

import pytest

from hil_bench.spawning import start_shielded


@pytest.mark.skipif(sys.platform != "linux", reason="signal masks are read from /proc")
def test_sigint_is_blocked_from_the_first_moment_on():
    process = multiprocessing.get_context("spawn").Process(target=signal.pause, daemon=True)
    start_shielded(process)
    status = Path(f"/proc/{process.pid}/status").read_text(encoding="ascii")
    process.kill()
    process.join()
    blocked = int(re.search(r"^SigBlk:\s*([0-9a-f]+)$", status, re.MULTILINE)[1], base=16)
    assert blocked & 1 << (signal.SIGINT - 1)  # proc(5): bit 0 is signal 1
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])
