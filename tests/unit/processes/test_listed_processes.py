import os
import subprocess
import sys

import pytest

from hil_bench.abilities.common.processes import living, read_status

NAMED = r"""
import sys
open("/proc/self/comm", "wb").write(b"\xff) R 1")
print(flush=True)
sys.stdin.read()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_a_process_of_any_name_is_found_in_its_group_and_session():
    """A name may have any bytes, those that end it in `/proc` too (proc_pid_stat(5))."""
    words = [sys.executable, "-c", NAMED]
    with subprocess.Popen(  # noqa: S603 - this program
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, process_group=0
    ) as child:
        child.stdout.readline()
        found = read_status(child.pid)
        assert (found.group, found.session) == (child.pid, os.getsid(0))
        assert child.pid in {each.pid for each in living()}
        child.kill()
    with pytest.raises(OSError, match="No such"):
        read_status(child.pid)
