"""A running bench in words: states, the loop, values in the units that people use."""

from collections.abc import Mapping
from typing import Any

from hil_bench.canopen_device.words import can_text
from hil_bench.errors import printable


def node_text(node: Mapping[str, Any]) -> str:
    """Return the state of a node in words."""
    device = f", {node['device']}" if node["device"] else ""
    errors = "".join(f", EMCY 0x{code:04X}" for code in node["errors"])
    can = f", {can_text(node['can'])}" if "can" in node else ""
    foreign = f", {node['foreign']} frames of another one" if "foreign" in node else ""
    return printable(f"{node['state']}{device}{errors}{can}{foreign}")


def ecu_text(ecu: Mapping[str, Any]) -> str:
    """Return the state of a J1939 device in words."""
    address = f", address {ecu['address']}" if ecu["state"] in _WITH_ADDRESS else ""
    codes = "".join(f", SPN {spn} FMI {fmi}" for spn, fmi in ecu["codes"])
    can = f", {can_text(ecu['can'])}" if "can" in ecu else ""
    return printable(f"{ecu['state']}{address}{codes}{can}")


def health_text(health: Mapping[str, Any]) -> str:
    """Return in words how the loop and the bus are."""
    parts = []
    for name, key in (("late", "lateness"), ("work", "work")):
        if key in health:
            times = health[key]
            parts.append(f"{name} p99 {times['p99_us']:.0f} max {times['max_us']:.0f} us")
    parts += [f"{health[key]} {word}" for key, word in _COUNTS.items() if key in health]
    if "bus_load" in health:
        parts.append(f"bus {health['bus_load'] * 100:.1f} %")
    return "  ".join(parts)


_WITH_ADDRESS = ("claiming", "claimed")

_COUNTS = {
    "overruns": "overran",
    "skipped": "skipped",
    "syncs": "SYNCs",
    "received": "in",
    "sent": "out",
}
