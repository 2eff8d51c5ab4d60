"""The faults that a page offers: each kind with its targets and their keys."""

from collections.abc import Mapping
from typing import Any

from hil_bench.config.settings import Key
from hil_bench.config.values import choice
from hil_bench.devices.faults.kind import FaultKind
from hil_bench.devices.faults.registry import LASTS_KEY, all_kinds
from hil_bench.session.live_faults import fault_keys


def fault_choices(hello: Mapping[str, Any]) -> dict[str, dict[str, list[dict[str, object]]]]:
    """Return the keys of each kind of fault that a bench can have, by kind and target.

    Args:
        hello: what the bench says of itself.
    """
    return {
        kind.name: {
            target: [_content(kind, key) for key in (*fault_keys(kind, target, hello), LASTS_KEY)]
            for target in kind.find_targets(hello.get("fault_targets", {}))[1]
            if _can_have(kind, target, hello)
        }
        for kind in all_kinds()
    }


def _can_have(kind: FaultKind, target: str, hello: Mapping[str, Any]) -> bool:
    """Return False if a kind is a defect that the plant or supply has not declared."""
    declared = hello.get("defects", {}).get(target)
    defects = kind.defects.values()
    return declared is None or not defects or any(name in declared for name in defects)


def _content(kind: FaultKind, key: Key) -> dict[str, object]:
    default = key.default if key.default is not None else key.example
    return {
        "name": key.name,
        "words": kind.word(key),
        "unit": key.unit.symbol,
        "default": None if key is LASTS_KEY else default,
        "is_needed": bool(key.example),
        "choices": [*key.read.words] if isinstance(key.read, choice) else None,
    }
