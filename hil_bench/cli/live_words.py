"""A running bench in words: states, faults, the loop, values in the units that people use."""

import math
from collections.abc import Mapping
from typing import Any

from hil_bench.errors import printable
from hil_bench.units import (
    BAR,
    MILLIMETRE,
    MILLIMETRE_PER_SECOND,
    REVOLUTION,
    REVOLUTION_PER_MINUTE,
    Unit,
)

_SHOWN = {
    "Pa": BAR,
    "m": MILLIMETRE,
    "m/s": MILLIMETRE_PER_SECOND,
    "rad": REVOLUTION,
    "rad/s": REVOLUTION_PER_MINUTE,
}
"""In which values are shown, by their SI unit."""


def shown_in(unit: str) -> Unit:
    """Return the unit in which a value in an SI unit is shown."""
    return _SHOWN.get(unit, Unit(unit, ""))


def value_text(value: float | None, unit: Unit) -> str:
    """Return a value that is given in SI as people read it; "-" where there is none."""
    if value is None or not math.isfinite(value):
        return "-"
    return f"{round(unit.from_si(value), 3) + 0.0:.3f}"  # no -0.000


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


def can_text(can: Mapping[str, Any]) -> str:
    """Return the state of a node's CAN controller on a bus of copper, without zero counts."""
    counts = "".join(f", {can[key]} {word}" for key, word in _CAN_COUNTS.items() if can[key])
    return f"{can['state']} TEC {can['tec']} REC {can['rec']}{counts}"


def fault_text(fault: Mapping[str, Any]) -> str:
    """Return a fault in words."""
    ends = "" if fault["ends"] is None else f", until {fault['ends']:.3f} s"
    text = f"{fault['kind']} {fault['target']} since {fault['begins']:.3f} s{ends}"
    return printable(text)


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

_CAN_COUNTS = {
    "failed": "repeated",
    "lost": "lost in a full buffer",
    "missed": "not read",
}
"""What a CAN controller counts, in words."""

_COUNTS = {
    "overruns": "overran",
    "skipped": "skipped",
    "syncs": "SYNCs",
    "received": "in",
    "sent": "out",
}
