"""The software: versions, buses, and extensions of other distributions."""

import importlib.metadata
import platform
import sys
from pathlib import Path
from typing import Any, cast

from hil_bench.abilities.doctor.machine import (
    IS_LINUX,
    Finding,
    Read,
    Topic,
    Verdict,
    absent,
    good,
    judged,
)
from hil_bench.ability import abilities, load, own_abilities
from hil_bench.bench.compiled import HOW, Core, look_at_core
from hil_bench.kinds.registry import KINDS
from hil_bench.outside.bits import bitrate_text
from hil_bench.outside.transports.can_interfaces import CanInterface, can_interfaces, has_socketcan
from hil_bench.outside.transports.socketcan import RECEIVE_BUFFER
from hil_bench.plants.hydraulic_cylinder.model.implicit_midpoint import advance_implicit_midpoint
from hil_bench.plants.hydraulic_cylinder.model.kernel import IS_COMPILED, ready
from hil_bench.plants.hydraulic_cylinder.model.machine_code import WANTS_PYTHON, find_machine_code
from hil_bench.plants.hydraulic_cylinder.model.moving import describe_kernels
from hil_bench.plants.registry import PLANTS
from hil_bench.registry import Extension, Registry

# Python and the libraries.

_LIBRARIES = ("numpy", "python-can", "canopen")
_INTERPRETED = "the plant takes 57 us of a tick in place of 2"


def examine_software() -> Topic:
    """Return the findings on Python and the libraries; a bench has been built before."""
    versions = [f"{name} {importlib.metadata.version(name)}" for name in _LIBRARIES]
    return Topic(
        "Software",
        (
            good("Python", f"{platform.python_version()} ({sys.executable})"),
            good("libraries", ", ".join(versions)),
            _core(look_at_core()),
            _kernel(),
        ),
    )


def _core(core: Core) -> Finding:
    name = "core of the bench"
    if not core.compiler:
        return Finding(name, Verdict.HINT, str(core), HOW)
    if core.edited:
        return Finding(name, Verdict.HINT, str(core), "install again, or pip install -e a checkout")
    return good(name, str(core))


def _kernel() -> Finding:
    name, what = "plant kernel", describe_kernels()
    if find_machine_code().bind is not None:
        return good(name, what)
    if not IS_COMPILED:
        remedy = "unset NUMBA_DISABLE_JIT" if WANTS_PYTHON else "pip install 'hil-bench[fast]'"
        return Finding(name, Verdict.HINT, what, f"{remedy}; {_INTERPRETED}")
    if find_machine_code().refusal:
        return Finding(name, Verdict.HINT, what, "each start imports Numba, which takes 0.7 s")
    statistics: Any = ready(advance_implicit_midpoint).stats  # type: ignore[attr-defined]  # Numba's
    version = f"{what} {importlib.metadata.version('numba')}"
    if statistics.cache_path is None:
        advice = "NUMBA_CACHE_DIR=DIR names a directory of yours, or each start compiles for 1 s"
        return Finding(name, Verdict.HINT, f"{version}, nowhere to cache it", advice)
    how = "cached" if statistics.cache_hits else "cached now"
    return good(name, f"{version}, {how} in {statistics.cache_path}")


# Extensions by other distributions: kinds of devices and of plants, and abilities.


def examine_extensions() -> Topic:
    """The kinds and abilities that are installed besides the bench's own; each is imported."""
    findings = [_kind("kind of device", extension) for extension in KINDS.extensions()]
    findings += [_kind("kind of plant", extension) for extension in PLANTS.extensions()]
    for ability in own_abilities():
        for what, place in ability.registries.items():
            registry = cast("Registry[object]", load(place))
            findings += [_kind(what, extension) for extension in registry.extensions()]
    findings += [_kind("ability", extension) for extension in abilities().extensions()]
    return Topic("Extensions", tuple(findings or [absent("kinds", "none installed")]))


def _kind(what: str, extension: Extension) -> Finding:
    value = f"{what}, {extension.distribution}"
    if extension.problem:
        return Finding(extension.name, Verdict.MISSING, f"{value}, not loaded", extension.problem)
    return good(extension.name, value)


# CAN on this machine.

_HUB = "'hil-bench run --hub' makes a bus without it"
_MODULES = ("/lib/modules", "/usr/lib/modules")


def examine_buses(read: Read) -> Topic:
    """Return the findings on CAN buses.

    Args:
        read: reads files of the kernel.
    """
    if not IS_LINUX:
        return Topic("CAN", (Finding("SocketCAN", Verdict.ABSENT, "Linux only", _HUB),))
    if not has_socketcan():
        advice = f"'modprobe can-raw' (root) where the kernel has the module; else {_HUB}"
        return Topic("CAN", (Finding("SocketCAN", Verdict.MISSING, "no AF_CAN", advice),))
    interfaces = can_interfaces()
    findings = [good("SocketCAN", "AF_CAN"), _vcan(read, interfaces), _receive_buffer(read)]
    findings += [_interface(interface) for interface in interfaces]
    if not interfaces:
        advice = "'ip link add dev vcan0 type vcan && ip link set vcan0 up' (root) makes one"
        findings.append(Finding("interfaces", Verdict.HINT, "none", advice))
    return Topic("CAN", tuple(findings))


def _vcan(read: Read, interfaces: list[CanInterface]) -> Finding:
    if any(interface.kind == "vcan" for interface in interfaces):
        return good("vcan", "in use")
    if Path("/sys/module/vcan").exists():
        return good("vcan", "loaded")
    if _has_module(read):
        return good("vcan", "there, 'modprobe vcan' (root) loads it")
    return Finding("vcan", Verdict.HINT, "no such module found", _HUB)


def _has_module(read: Read) -> bool:
    folders = [f"{root}/{platform.release()}" for root in _MODULES]
    names = ("modules.builtin", "modules.dep")
    return any("/vcan.ko" in read(f"{folder}/{name}") for folder in folders for name in names)


def _receive_buffer(read: Read) -> Finding:
    most = read("/proc/sys/net/core/rmem_max")
    if not most.isdigit():
        return absent("receive buffer", "unknown")
    return judged(
        "receive buffer",
        f"up to {int(most) // 1024} KiB; CAP_NET_ADMIN needs no limit",
        f"'sysctl -w net.core.rmem_max={RECEIVE_BUFFER}', or a flood may lose frames",
        is_good=int(most) >= RECEIVE_BUFFER,
    )


def _interface(interface: CanInterface) -> Finding:
    rate = f", {bitrate_text(interface.bitrate)}" if interface.bitrate else ""
    value = f"{interface.kind or 'CAN'}, {'up' if interface.is_up else 'down'}{rate}"
    start = f"'ip link set {interface.name} up"
    if interface.kind == "can" and not interface.bitrate:
        start += " type can bitrate 500000"
    return judged(interface.name, value, f"{start}'", is_good=interface.is_up)
