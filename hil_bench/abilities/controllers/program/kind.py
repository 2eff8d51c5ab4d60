"""The kind `program`: an unmodified Linux program with CAN sockets, on the bench's clock."""

import os
import platform
import shutil
import stat
import struct
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hil_bench.abilities.controllers.process.kind import EMPTY
from hil_bench.abilities.controllers.seam import Controller, ControllerKind, Surroundings
from hil_bench.config.settings import Key
from hil_bench.config.values import choice, number, texts
from hil_bench.errors import ConfigError
from hil_bench.units import SECOND

BENCH_TIME, REAL_TIME = "bench", "real"


class ProgramKind(ControllerKind):
    """A program of this machine."""

    name = "program"
    summary = "a Linux program with SocketCAN, no line changed"
    keys = (
        Key("command", texts, example='["build/position_control", "--bus", "{bus}"]'),
        Key("time", choice((BENCH_TIME, REAL_TIME)), BENCH_TIME),
        Key("cpu_s_per_tick", number(SECOND, low=0.1), 5.0, SECOND),
    )

    def problems(self, settings: Mapping[str, Any], folder: Path) -> Sequence[str]:
        """Return why no library can be preloaded into the program, where it is there already."""
        del folder
        if not sys.platform.startswith("linux"):
            return ["kind: programs run on Linux; take another kind here"]
        command = settings["command"]
        if not command:
            return [EMPTY]
        fault = find_fault(command[0])
        return [f"command: {fault}"] if fault else ()

    def build(self, settings: Mapping[str, Any], surroundings: Surroundings) -> Controller:
        """Return the program, not yet started.

        Raises:
            ConfigError: no library can be preloaded into it.
        """
        from hil_bench.abilities.controllers.program.controller import (  # noqa: PLC0415 - seldom
            ProgramController,
        )
        from hil_bench.abilities.controllers.program.preload import find_library  # noqa: PLC0415

        if fault := find_fault(surroundings.filled(settings["command"][0])):
            raise ConfigError(f"{surroundings.place}.command: {fault}")
        return ProgramController(
            settings["command"],
            find_library(),
            settings["cpu_s_per_tick"],
            surroundings,
            is_real=settings["time"] == REAL_TIME,
        )


KIND = ProgramKind()


# Looks at a program before it is run: what cannot have a library preloaded is refused.

_MACHINES = {"x86_64": 62, "aarch64": 183, "riscv64": 243}
_PT_INTERP = 3
_HEAD = 4096
_MOST_INTERPRETERS = 4


def find_fault(word: str) -> str:
    """Return why the library cannot be preloaded into a program; empty where it can.

    Args:
        word: the first of a command line; a program that is not there has no fault.
    """
    for _ in range(_MOST_INTERPRETERS):
        found = shutil.which(word)
        if found is None:
            return ""
        path = Path(found).resolve()
        with path.open("rb") as file:
            head = file.read(_HEAD)
        if not head.startswith(b"#!"):
            return _fault_of_file(path, head)
        words = head[2:].partition(b"\n")[0].decode(errors="replace").split()
        is_env = len(words) > 1 and Path(words[0]).name == "env" and words[1][0] != "-"
        word = words[1] if is_env else words[0] if words else ""
    return ""


def _fault_of_file(path: Path, head: bytes) -> str:
    status = path.stat()
    if (status.st_mode & stat.S_ISUID and status.st_uid != os.geteuid()) or (
        status.st_mode & stat.S_ISGID and status.st_gid != os.getegid()
    ):
        return f"{path}: is setuid or setgid, so that no library can be preloaded; run a copy"
    if "security.capability" in _attributes(path) and os.geteuid():
        return f"{path}: has capabilities, so that no library can be preloaded; run a copy"
    if not head.startswith(b"\x7fELF"):
        return f"{path}: is no program of Linux (ELF)"
    try:
        return _fault_of_elf(path, head)
    except struct.error:
        return f"{path}: is cut off within its head; link it anew"


def _attributes(path: Path) -> list[str]:
    try:
        return os.listxattr(path)
    except OSError:
        return []


def _fault_of_elf(path: Path, head: bytes) -> str:
    right = f"a program for {platform.machine()} is right"
    (machine,) = struct.unpack_from("<H", head, 18)
    if head[4:6] != b"\x02\x01" or machine != _MACHINES.get(platform.machine(), machine):
        return f"{path}: is for another processor; {right}"
    (table,) = struct.unpack_from("<Q", head, 32)
    size, count = struct.unpack_from("<HH", head, 54)
    for place in range(table, table + size * count, size):
        (kind,) = struct.unpack_from("<I", head, place)
        if kind == _PT_INTERP:
            begin, length = _segment(head, place)
            is_musl = b"musl" in head[begin : begin + length]
            return f"{path}: is linked with musl; glibc is right" if is_musl else ""
    return f"{path}: is linked statically, so that no library can be preloaded; link it with libc"


def _segment(head: bytes, place: int) -> tuple[int, int]:
    (begin,) = struct.unpack_from("<Q", head, place + 8)
    (length,) = struct.unpack_from("<Q", head, place + 32)
    return begin, length
