"""Doubts about a configuration: values that no machine has, motion that no step resolves."""

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Final

from hil_bench.bench.configuration.records import BenchConfig
from hil_bench.config.settings import Origin, Problems, Range, Setting, Settings, quote_name
from hil_bench.config.values import find_nearest, quote
from hil_bench.plants.hydraulic_cylinder.data_sheet.oil import find_assumed_supply
from hil_bench.plants.plant import PlantKind
from hil_bench.plants.registry import DEFAULT_PLANT, PLANTS

Kind = PlantKind[Any]

_BOUND = re.compile(r'\bdata-(?!port|number|label)\w+="(\w+)')
"""A quantity that a picture binds (docs/plugins.md)."""

_PREFIXES = {1e-9: "n", 1e-6: "u", 1e-3: "m", 1.0: "", 1e3: "k", 1e6: "M", 1e9: "G", 1e12: "T"}
_BASES = {"bar": "Pa", "MPa": "Pa", "Pa": "Pa", "mm": "m", "N": "N", "kg": "g"}
"""Units whose values read well with a prefix, and what takes it."""
_GRAMS = 1e3

_SHARE = 1e-3
"""Next to nothing is usual in many units: that shows no mistake."""

MISTAKEN: Final[Mapping[str, Mapping[str, float]]] = {
    "bar": {"pascal": 1e-5, "kPa": 1e-2, "MPa": 10.0, "psi": 0.0689476},
    "MPa": {"pascal": 1e-6, "kPa": 1e-3, "bar": 0.1, "GPa": 1e3},
    "mm": {"um": 1e-3, "m": 1e3},
    "mm/s": {"m/s": 1e3},
    "cm²": {"mm²": 1e-2, "m²": 1e4},
    "cm³": {"mm³": 1e-3, "l": 1e3, "m³": 1e6},
    "kg": {"g": 1e-3, "t": 1e3},
    "kg/m³": {"g/cm³": 1e3},
    "rad/s": {"Hz": 2.0 * math.pi},
    "N": {"kN": 1e3},
    "N/mm": {"N/m": 1e-3},
    "l/min": {"l/s": 60.0, "m³/s": 6e4},
    "ms": {"us": 1e-3, "s": 1e3},
    "%": {"a fraction": 100.0},
}
"""By the unit of a key: other units that are given in its place, and what one of them is."""


def check_possible(axis: Settings, kind: Kind, problems: Problems) -> None:
    """Note values of an axis' keys that nature does not allow."""
    for setting in axis.values():
        possible = kind.possible.get(setting.key.name)
        if possible is not None and not _is_within(setting, possible):
            place = problems.place(setting.table, setting.key.name)
            problems.add(place, _explain(setting, kind, possible, "possible"))


def find_doubts(config: BenchConfig) -> list[str]:
    """Return the implausible values of a configuration, a line each."""
    source = str(config.path) if config.path else "built-in bench"
    kinds = {f"plant.{axis.name}": axis.kind for axis in config.axes}
    supplies = {f"supply.{supply.name}": DEFAULT_PLANT for supply in config.supplies}
    return [
        *_unusual(source, kinds | supplies, config.settings),
        *_left_over(source, kinds | supplies, supplies, config.settings),
        *_unresolved(source, config),
        *_out_of_reach(source, config),
        *_unknown_names(source, config),
        *(f"{source}:{doubt}" for part in config.parts for doubt in part.find_doubts(config)),
    ]


def _unknown_names(source: str, config: BenchConfig) -> Iterator[str]:
    """Yield the names in the page of a foreign plant that lead nowhere."""
    for axis in config.axes:
        kind = axis.kind
        if kind.name in PLANTS.built_in:
            continue
        place = f"{source}:plant.{quote_name(axis.name)}: {kind.name}"
        page, recorded = (
            kind.page(axis),
            [each.name for each in kind.quantities if each.is_recorded],
        )
        bound = [] if page is None else [*_BOUND.findall(page.svg), *page.plots]
        for name in dict.fromkeys(bound):
            if name not in recorded:
                right = f"the nearest is {find_nearest(name, recorded)}"
                yield f"{place}: its page shows {quote(name)}, which is not recorded; {right}"


def _left_over(
    source: str,
    kinds: Mapping[str, Kind],
    supplies: Collection[str],
    settings: Sequence[Setting],
) -> Iterator[str]:
    """Yield the defaults that fit badly to what the file says of an axis, or of a supply."""
    for table, kind in kinds.items():
        of_axis = {each.key.name: each for each in settings if each.table == table}
        found = find_assumed_supply(of_axis) if table in supplies else kind.find_leftovers(of_axis)
        for key, why in found:
            yield f"{source}:{table}.{quote_name(key)}: {why}"


def _unusual(source: str, kinds: Mapping[str, Kind], settings: Sequence[Setting]) -> Iterator[str]:
    for setting in settings:
        kind = kinds.get(setting.table)
        usual = kind and kind.usual.get(setting.key.name)
        is_own = setting.origin is not Origin.DATA_SHEET  # else its data are compared
        if kind and usual and is_own and not _is_within(setting, usual):
            place = f"{source}:{setting.table}.{quote_name(setting.key.name)}"
            yield f"{place}: {_explain(setting, kind, usual, 'usual')}"


def _is_within(setting: Setting, allowed: Range) -> bool:
    value = setting.value
    return value is None or allowed.low <= value <= allowed.high


def _explain(setting: Setting, kind: Kind, allowed: Range, what: str) -> str:
    """Describe an implausible value: its usual range, and the unit that may have been meant."""
    value, unit = setting.value, setting.key.unit
    text = f"{value:.10g}{_in_prefixed_units(value, setting)}; {_range_text(allowed)} is {what}"
    usual = kind.usual.get(setting.key.name, allowed)
    for other, factor in MISTAKEN.get(unit.symbol, {}).items():
        meant = value * factor
        if usual.low <= meant <= usual.high and abs(meant) >= _SHARE * usual.high:
            return f"{text} ({allowed.reason}); {other} in the {unit.symbol} key?"
    return f"{text} ({allowed.reason})"


def _in_prefixed_units(value: float, setting: Setting) -> str:
    """Return the value as people say it, such as 2.1 TPa; empty where the key's unit does."""
    unit = setting.key.unit
    base = _BASES.get(unit.symbol)
    if base is None or not value:
        return ""
    size = abs(value * unit.factor * (_GRAMS if base == "g" else 1.0))
    if setting.key.field == "h":  # the stroke's key converts to half of it
        size *= 2.0
    prefix = max((one for one in _PREFIXES if one <= size), default=min(_PREFIXES))
    said = f"{math.copysign(size / prefix, value):.3g} {_PREFIXES[prefix]}{base}"
    return "" if said == f"{value:.3g} {unit.symbol}" else f" is {said}"


def _range_text(allowed: Range) -> str:
    if math.isinf(allowed.high):
        return f"{allowed.low:.10g} or more"
    if math.isinf(allowed.low):
        return f"up to {allowed.high:.10g}"
    return f"{allowed.low:.10g} to {allowed.high:.10g}"


def _unresolved(source: str, config: BenchConfig) -> Iterator[str]:
    """Yield the motions that are too fast for the tick, or for the solver's step."""
    for axis in config.axes:
        place = f"{source}:plant.{quote_name(axis.name)}"
        for doubt in axis.kind.find_doubts(axis, config.tick_ns // 1000, config.step_ns // 1000):
            yield f"{place}: {doubt}"


def _out_of_reach(source: str, config: BenchConfig) -> Iterator[str]:
    """Yield the results of the data together that no machine reaches, such as a speed."""
    for axis in config.axes:
        place = f"{source}:plant.{quote_name(axis.name)}"
        facts = axis.kind.summarise(axis, config.tick_ns // 1000, config.step_ns // 1000)
        for fact in facts if axis.kind.usual_results else ():
            usual = axis.kind.usual_results.get(fact.name)
            if usual is not None and not usual.low <= fact.value <= usual.high:
                wrong = f"{fact.name} is {fact.value:.4g} {fact.unit}"
                yield f"{place}: {wrong}; {_range_text(usual)} is usual ({usual.reason})"
