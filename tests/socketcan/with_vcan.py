"""Run a command where a SocketCAN interface vcan0 is: ``with_vcan.py COMMAND [ARGUMENT ...]``.

Where this kernel has vcan, the command runs in a network namespace of its own with a fresh vcan0.
Elsewhere it runs in a User-Mode Linux that takes this machine's file system as its root, so the
same checkout and the same virtual environment are there; no privileges are needed for that. The
User-Mode Linux runs with uml_xstate.c preloaded, since it dies on newer processors otherwise.

The exit code is the command's own; 124 after the time limit; 69 where neither way exists.
"""

import argparse
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

EXIT_TIMEOUT = 124  # as timeout(1)
EXIT_UNAVAILABLE = 69  # EX_UNAVAILABLE of sysexits.h
UNAVAILABLE = (
    "with_vcan: this kernel gives no vcan interface, and {reason}; either modprobe vcan, or "
    "apt-get install user-mode-linux kmod iproute2 busybox-static gcc libc6-dev"
)
UML_XSTATE = Path(__file__).with_name("uml_xstate.c")
PRELOAD = "LD_PRELOAD"
MAKE_VCAN = "ip link set lo up && ip link add dev vcan0 type vcan && ip link set vcan0 up"


def main():
    """Return the exit code of the command that the command line names."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--timeout", type=float, default=600.0, help="limit [s], default 600")
    parser.add_argument("--uml", action="store_true", help="User-Mode Linux in any case")
    parser.add_argument("command", nargs=argparse.REMAINDER)
    arguments = parser.parse_args()
    if not arguments.command:
        parser.error("a command is missing")
    signal.signal(signal.SIGTERM, lambda number, _frame: sys.exit(128 + number))
    if not arguments.uml and (prefix := namespace_prefix()):
        print("with_vcan: vcan0 of this kernel, in a network namespace of its own", flush=True)
        return run([*prefix, *arguments.command], arguments.timeout)
    try:
        return run_in_user_mode_linux(arguments.command, arguments.timeout)
    except LookupError as error:
        print(UNAVAILABLE.format(reason=error), file=sys.stderr)
        return EXIT_UNAVAILABLE


def namespace_prefix():
    """Return what to put before a command to run it beside a vcan0; empty where that fails."""
    if not (shutil.which("unshare") and shutil.which("ip")):
        return []
    as_root = [] if os.geteuid() == 0 else ["--map-root-user"]
    prefix = ["unshare", "--net", *as_root, "sh", "-c", f'{MAKE_VCAN} && exec "$@"', "sh"]
    trial = subprocess.run([*prefix, "true"], capture_output=True, check=False)
    return prefix if trial.returncode == 0 else []


def run_in_user_mode_linux(command, timeout):
    """Return the command's exit code, which comes back in a file: the kernel's own says nothing.

    Raises:
        LookupError: this machine lacks a program that is needed; the message says which.
    """
    if not shutil.which("linux.uml"):
        raise LookupError("User-Mode Linux is not installed")
    with tempfile.TemporaryDirectory(prefix="with-vcan-") as job_dir:
        library = build_uml_xstate(Path(job_dir))
        # A kernel ends its parameters at blanks, which the path of a checkout may have.
        init = shutil.copy(Path(__file__).with_name("uml_init.sh"), job_dir)
        print(f"with_vcan: vcan0 of a User-Mode Linux, {UML_XSTATE.name} preloaded", flush=True)
        (Path(job_dir) / "job.sh").write_text(job_script(command))
        root = ["rootfstype=hostfs", "rootflags=/", "rw", f"init={init}", f"job_dir={job_dir}"]
        console = ["con=null", "con0=fd:0,fd:1", "quiet", "loglevel=1"]
        preloaded = f"{library} {os.environ.get(PRELOAD, '')}".strip()
        # It has one processor and traces its processes: each of their system calls is a switch to
        # and fro, which takes half the time where both stay on one processor of this machine.
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
        kernel_exit_code = run(
            ["linux.uml", "mem=1G", *root, *console], timeout, os.environ | {PRELOAD: preloaded}
        )
        exit_code = Path(job_dir) / "exit_code"
        if exit_code.exists():
            return int(exit_code.read_text())
        return kernel_exit_code or 1


def build_uml_xstate(directory):
    """Return the library that User-Mode Linux needs on newer processors, compiled into a directory.

    Raises:
        LookupError: there is no C compiler, or it lacks the headers of libc.
    """
    if not shutil.which("gcc"):
        raise LookupError("User-Mode Linux needs gcc, which is not installed")
    library = directory / UML_XSTATE.with_suffix(".so").name
    compiler = ["gcc", "-shared", "-fPIC", "-O2", "-Wall", "-Wextra", "-Werror"]
    done = subprocess.run(
        [*compiler, "-o", str(library), str(UML_XSTATE)],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        print(done.stderr, file=sys.stderr)
        raise LookupError(f"gcc cannot compile {UML_XSTATE.name}")
    return library


def job_script(command):
    """Return a shell script that runs the command as here, with its temporary files on a tmpfs.

    Libraries that are preloaded here serve the User-Mode Linux itself: nothing inside it gets them.
    """
    environment = os.environ | {"TMPDIR": "/run", "TERM": "dumb"}
    exports = [
        f"export {name}={shlex.quote(value)}"
        for name, value in environment.items()
        if name.isidentifier()  # leaves out functions that bash has exported
        and name != PRELOAD
    ]
    change_directory = f"cd {shlex.quote(str(Path.cwd()))}"
    return "\n".join([*exports, change_directory, f"exec {shlex.join(command)} </dev/null", ""])


def run(command, timeout, environment=None):
    """Return the command's exit code; 124 where its process group had to be killed.

    The output passes through a pipe, since a User-Mode Linux sets a terminal that it writes to to
    raw mode.
    """
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        start_new_session=True,
        env=environment,
    ) as process:
        is_late = threading.Event()

        def kill_late():
            is_late.set()
            os.killpg(process.pid, signal.SIGKILL)

        timer = threading.Timer(timeout, kill_late)
        timer.start()
        try:
            copy_lines(process)
            process.wait()
        except BaseException:  # Ctrl-C or SIGTERM: the command must not outlive this program
            os.killpg(process.pid, signal.SIGKILL)
            raise
        finally:
            timer.cancel()
    if is_late.is_set():
        print(f"with_vcan: killed after {timeout:g} s: {shlex.join(command)}", file=sys.stderr)
        return EXIT_TIMEOUT
    return process.returncode


def copy_lines(process):
    """Copy the output of a process to the standard output until it ends."""
    assert process.stdout
    for line in process.stdout:
        sys.stdout.buffer.write(line)
        sys.stdout.buffer.flush()


if __name__ == "__main__":
    sys.exit(main())
