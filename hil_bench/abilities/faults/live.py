"""Faults of a running bench, in the keys and units of ``[[faults]]``, and back."""

from collections.abc import Mapping, Sequence
from typing import Any

from hil_bench.abilities.faults.kind import UNITS, FaultKind
from hil_bench.abilities.faults.registry import COMMON_KEYS, LASTS_KEY, find_fault_kind
from hil_bench.abilities.faults.section import check_effect
from hil_bench.config.settings import Given, Key, Origin, Problems, convert, read_table
from hil_bench.errors import ConfigError


def fault_fields(table: Mapping[str, object], hello: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of the request for a fault; where they are wrong, a `ConfigError` says so.

    Args:
        table: kind, target and the other keys of ``[[faults]]``.
        hello: what the bench says of itself.
    """
    kind = find_fault_kind(table["kind"])
    keys = (*COMMON_KEYS, *kind.keys)
    given = {
        key: Given(value, Origin.COMMAND_LINE, f"fault {kind.name} {key}")
        for key, value in table.items()
    }
    problems = Problems("fault")
    settings = read_table("fault", given, keys, problems)
    problems.raise_any()
    check_effect(settings, problems)
    problems.raise_any()
    chosen = [key for key in keys if key.name in table and key.name not in {"kind", "target"}]
    _check_unit(kind, str(table["target"]), [key.name for key in chosen], hello)
    return {"kind": kind.name, "target": table["target"], "arguments": convert(settings, chosen)}


def fault_keys(kind: FaultKind, target: str, hello: Mapping[str, Any]) -> list[Key]:
    """Return the keys of a kind beside the common ones, in the unit of what the target measures."""
    unit = measured_suffix(target, hello)
    return [key for key in kind.keys if key not in kind.amounts or not unit or unit in key.name]


def fault_table(fields: Mapping[str, Any], hello: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys of ``[[faults]]`` for the fields of a request, its time left out."""
    kind, arguments = find_fault_kind(fields["kind"]), fields.get("arguments", {})
    keys = [LASTS_KEY, *fault_keys(kind, fields["target"], hello)]
    table: dict[str, Any] = {"kind": kind.name, "target": fields["target"]}
    for key in keys:
        value = arguments.get(key.field or key.name)
        if value is not None:
            is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
            table[key.name] = round(key.unit.from_si(value), 12) if is_number else value
    return table


def measured_suffix(target: str, hello: Mapping[str, Any]) -> str:
    """Return the suffix of the unit of what a sensor measures; empty where it is none."""
    unit = UNITS.get(dict(hello["channels"]).get(f"{target}.measured", ""))
    return "" if unit is None else unit.suffix


def _check_unit(
    kind: FaultKind, target: str, names: Sequence[str], hello: Mapping[str, Any]
) -> None:
    """Check that an amount is in the unit of what the sensor measures.

    Raises:
        ConfigError: it is not.
    """
    suffix, known = measured_suffix(target, hello), [key.name for key in kind.amounts]
    if not suffix or not known:
        return
    (right,) = (name for name in known if suffix in name)
    for name in set(names).intersection(known) - {right}:
        wrong = f"{name} is not what it measures; give {right}"
        raise ConfigError(f"fault {kind.name} {target}: {wrong}")
    if right not in names:
        raise ConfigError(f"fault {kind.name} {target}: give {right}=1, for example")
