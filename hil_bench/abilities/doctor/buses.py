"""CAN on this machine."""

import platform
from pathlib import Path

from hil_bench.abilities.doctor.finding import (
    IS_LINUX,
    Finding,
    Read,
    Topic,
    Verdict,
    absent,
    good,
    judged,
)
from hil_bench.outside.transports.bus_load import bitrate_text
from hil_bench.outside.transports.can_interfaces import CanInterface, can_interfaces, has_socketcan
from hil_bench.outside.transports.socketcan import RECEIVE_BUFFER

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
