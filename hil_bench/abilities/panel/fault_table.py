"""The faults that a page offers: each kind with its targets and their keys."""

from collections.abc import Mapping
from typing import Any

from hil_bench.bench.configuration.fault_keys import COMMON_KEYS
from hil_bench.config.settings import Key
from hil_bench.devices.faults.kinds import (
    DEFECT_KINDS,
    DEFECTS,
    ECU_KINDS,
    LEAKS,
    VALVE_KINDS,
    WIRE_KINDS,
    BrokenReading,
    FaultDirection,
    FaultKind,
    LeakPath,
)
from hil_bench.devices.j1939.diagnostics import Lamp
from hil_bench.devices.j1939.signal_table import Indication
from hil_bench.session.live_faults import fault_keys

_CHOICES: Mapping[str, list[str]] = {
    "direction": [*FaultDirection],
    "path": [*LeakPath],
    "reads": [*BrokenReading],
    "shows": [*Indication],
    "lamp": [lamp.name.lower() for lamp in Lamp],
}

_GROUPS: Mapping[FaultKind, tuple[str, ...]] = {
    **dict.fromkeys(
        (
            FaultKind.FREEZE,
            FaultKind.OFFSET,
            FaultKind.DRIFT,
            FaultKind.NOISE,
            FaultKind.BREAK_WIRE,
        ),
        ("sensors",),
    ),
    FaultKind.SLOW: ("sensors", "valves"),
    **dict.fromkeys(VALVE_KINDS, ("valves",)),
    FaultKind.DROP_SUPPLY: ("supplies",),
    **dict.fromkeys(DEFECT_KINDS, ("plants",)),
    **dict.fromkeys(WIRE_KINDS, ("wired",)),
    **dict.fromkeys(ECU_KINDS, ("ecus",)),
    FaultKind.INDICATE: ("signals",),
}


_WORDS: Mapping[str, str] = {
    "for_s": "duration",
    "growth_s": "time to grow",
    "can_id": "CAN identifier",
    "leak_l_min_bar": "leakage",
    "path": "leaks at",
}
"""What a page calls a key whose name is not enough."""


def fault_choices(hello: Mapping[str, Any]) -> dict[str, dict[str, list[dict[str, object]]]]:
    """Return the keys of each kind of fault that a bench can have, by kind and target.

    Args:
        hello: what the bench says of itself.
    """
    groups: Mapping[str, list[str]] = hello.get("fault_targets", {})
    return {
        kind.value: {
            target: [_content(key) for key in (*fault_keys(kind, target, hello), COMMON_KEYS[-1])]
            for group in _GROUPS.get(kind, ("nodes",))
            for target in groups.get(group, ())
            if _can_have(kind, target, hello)
        }
        for kind in FaultKind
    }


def _can_have(kind: FaultKind, target: str, hello: Mapping[str, Any]) -> bool:
    """Return False if a kind is a defect that the plant or supply has not declared."""
    declared = hello.get("defects", {}).get(target)
    if declared is None or kind not in DEFECT_KINDS:
        return True
    names = LEAKS.values() if kind is FaultKind.LEAK else (DEFECTS[kind],)
    return any(name in declared for name in names)


def _content(key: Key) -> dict[str, object]:
    default = key.default if key.default is not None else key.example
    return {
        "name": key.name,
        "words": _WORDS.get(key.name)
        or key.name.removesuffix(key.unit.suffix).replace("_", " ").strip(),
        "unit": key.unit.symbol,
        "default": None if key.name == "for_s" else default,
        "is_needed": bool(key.example),
        "choices": _CHOICES.get(key.name),
    }
