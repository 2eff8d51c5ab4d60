"""User-Mode Linux on hosts that have more registers than it knows."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support.dissection import require_tool

HERE = Path(__file__).parent
WITH_VCAN = HERE.parent / "socketcan" / "with_vcan.py"
UML_XSTATE = WITH_VCAN.with_name("uml_xstate.c")
FAKE_UML = """#!/bin/sh
for argument in "$@"; do
    case $argument in job_dir=*) job_dir=${argument#job_dir=} ;; esac
done
echo "outside: $LD_PRELOAD"
cat "$job_dir/job.sh"
echo 7 >"$job_dir/exit_code"
"""


@pytest.fixture
def compiled(tmp_path):
    """Compile a C file to a library."""
    require_tool("gcc")

    def build(source):
        library = tmp_path / f"{source.stem}.so"
        strict = ["-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
        subprocess.run(["gcc", "-shared", "-fPIC", *strict, "-o", library, source], check=True)
        return library

    return build


def preloaded(*libraries):
    return os.environ | {"LD_PRELOAD": " ".join(map(str, libraries))}


def trace_child(*libraries):
    command = [sys.executable, HERE / "trace_child.py"]
    done = subprocess.run(
        command, env=preloaded(*libraries), capture_output=True, text=True, check=False
    )
    if done.stderr.startswith("no "):
        pytest.skip(done.stderr)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def with_vcan(*arguments, **environment):
    command = [sys.executable, WITH_VCAN, "--uml", *arguments]
    return subprocess.run(
        command, env=os.environ | environment, capture_output=True, text=True, check=False
    )


def test_without_the_library_a_part_is_refused(compiled):
    """Or the next tests would show nothing."""
    assert trace_child() == ["EFAULT"]
    assert trace_child(compiled(HERE / "larger_host.c")) == ["EFAULT"]


def test_a_part_is_written_and_the_other_registers_stay(compiled):
    library = compiled(UML_XSTATE)
    assert trace_child(library) == ["EINVAL"]
    assert trace_child(library, compiled(HERE / "larger_host.c")) == ["EINVAL"]


@pytest.mark.long
def test_it_boots_on_a_host_with_more_registers(compiled):
    require_tool("linux.uml", "user-mode-linux")
    larger_host = compiled(HERE / "larger_host.c")
    done = with_vcan(
        *("sh", "-c", "ls /sys/class/net; env; tr '\\0' '\\n' </proc/1/environ; exit 3"),
        LD_PRELOAD=str(larger_host),
    )
    assert done.returncode == 3, done.stdout + done.stderr
    assert "with_vcan: vcan0 of a User-Mode Linux, uml_xstate.c preloaded" in done.stdout
    assert "vcan0" in done.stdout.split()
    assert "LD_PRELOAD" not in done.stdout


def path_with(tmp_path, *tools):
    """A PATH on which there are these tools, and a User-Mode Linux that shows its job."""
    fake = tmp_path / "linux.uml"
    fake.write_text(FAKE_UML)
    fake.chmod(0o755)
    for tool in tools:
        (tmp_path / tool).symlink_to(shutil.which(tool))
    return str(tmp_path)


def test_only_user_mode_linux_itself_gets_the_library(tmp_path):
    require_tool("gcc")
    path = path_with(tmp_path) + os.pathsep + os.environ["PATH"]
    done = with_vcan("true", PATH=path, LD_PRELOAD="libc.so.6")
    assert done.returncode == 7, done.stderr
    outside, job = done.stdout.split("outside: ")[1].split("\n", 1)
    library, other = outside.split()
    assert (Path(library).name, other) == ("uml_xstate.so", "libc.so.6")
    assert "export PATH=" in job
    assert "LD_PRELOAD" not in job


def test_without_a_compiler_it_says_what_to_install(tmp_path):
    done = with_vcan("true", PATH=path_with(tmp_path))
    assert (done.returncode, done.stdout) == (69, "")
    assert done.stderr == (
        "with_vcan: this kernel gives no vcan interface, and User-Mode Linux needs gcc, which is "
        "not installed; either modprobe vcan, or "
        "apt-get install user-mode-linux kmod iproute2 busybox-static gcc libc6-dev\n"
    )
