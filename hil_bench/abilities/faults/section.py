"""The tables ``[[faults]]``: what goes wrong by itself, and when."""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, runtime_checkable

from hil_bench.abilities.faults import points
from hil_bench.abilities.faults.fault import FaultConfig
from hil_bench.abilities.faults.kind import UNITS
from hil_bench.abilities.faults.registry import (
    COMMON_KEYS,
    KIND_KEY,
    all_kinds,
    find_fault_kind,
    missing_defect,
)
from hil_bench.bench.configuration.axes import Axes
from hil_bench.bench.configuration.nodes import Bindings, places_of
from hil_bench.bench.configuration.nodes_section import Whole
from hil_bench.bench.configuration.records import BenchConfig, Part
from hil_bench.config.document import Document
from hil_bench.config.settings import (
    Given,
    Origin,
    Problems,
    Settings,
    convert,
    give,
    quote_name,
    read_table,
)
from hil_bench.config.values import describe, find_nearest, quote
from hil_bench.devices.kinds.bindings import SinkConfig, SourceConfig
from hil_bench.devices.kinds.registry import kind_of
from hil_bench.errors import ConfigError
from hil_bench.plants.plant import SUPPLY
from hil_bench.plants.registry import PLANTS as OWN_PLANTS
from hil_bench.units import BAR, Unit

if TYPE_CHECKING:
    from hil_bench.abilities.faults.faults import Faults
    from hil_bench.bench.bench import Bench

Targets = dict[str, dict[str, Any]]
"""The names of the targets that may have faults, by group.

Of sensors with the unit of their amounts, None where `[[faults]]` has no key for it; of supplies
with the least pressure [bar].
"""


@dataclass(frozen=True, slots=True)
class FaultsPart(Part):
    """The faults of a bench.

    Attributes:
        faults: in the order of the file, those of the command line last.
        sensor_units: the unit in which a fault of a sensor has its amount, by the sensor's name;
            None where faults have no key for it.
    """

    faults: tuple[FaultConfig, ...] = ()
    sensor_units: Mapping[str, Unit | None] = field(default_factory=dict, compare=False)

    @property
    def lines(self) -> tuple[str, ...]:
        """The faults with their times, a line each."""
        return tuple(f"fault  {_text_of(fault)}" for fault in self.faults)

    def sound(self) -> "FaultsPart":
        """Return the part without the faults."""
        return replace(self, faults=())

    def find_doubts(self, config: BenchConfig) -> Iterator[str]:
        """Yield the defects of foreign plants that no kind of fault makes."""
        axes = [axis for axis in config.axes if axis.kind.name not in OWN_PLANTS.built_in]
        made = {name for kind in all_kinds() for name in kind.defects.values()} if axes else set()
        for axis in axes:
            place = f"plant.{quote_name(axis.name)}: {axis.kind.name}"
            for each in axis.defects:
                if each.name not in made:
                    right = f"the nearest that one makes is {find_nearest(each.name, made)}"
                    yield f"{place}: no kind of fault makes its defect {quote(each.name)}; {right}"

    def extension(self, config: BenchConfig, bench: "Bench") -> "Faults":
        """Return the faults of a bench, those of the file planned."""
        from hil_bench.abilities.faults.building import build_faults  # noqa: PLC0415 - takes long

        return build_faults(config, bench, self.faults)


def _text_of(fault: FaultConfig) -> str:
    """Describe a fault and its time."""
    lasts = "" if fault.duration is None else f", for {fault.duration:g} s"
    return f"{fault.kind} {fault.target} at {fault.at:g} s{lasts}"


@runtime_checkable
class Fallible(Protocol):
    """A section whose devices may have faults, beside those that each bench has."""

    def fault_targets(self) -> Mapping[str, Mapping[str, Any]]:
        """Return the targets of faults: their names by group, of sensors with a unit."""


class FaultsSection:
    """The faults of the file, then those of the command line.

    Args:
        document: the file.
        whole: the sections of the bench.
        problems: where problems are noted.

    Attributes:
        of_bench: True: it is made with all other sections of the bench.
    """

    of_bench: ClassVar[bool] = True

    def __init__(self, document: Document, whole: Whole, problems: Problems) -> None:
        self._faults = _read_faults(document, whole.given.get("faults", ()), problems)
        self._whole, self._problems = whole, problems
        self._sensors: Mapping[str, Unit | None] = {}

    def resolve(self) -> None:
        """Note faults of what the bench does not have."""
        axes, wired, nodes, peers, _ = self._whole
        targets = _find_targets(nodes.nodes, axes.axes, nodes.bindings)
        for section in peers.values():
            found = section.fault_targets() if isinstance(section, Fallible) else {}
            for group, names in found.items():
                targets.setdefault(group, {}).update(names)
        lowest = axes.supplies.lowest_bar
        targets[points.SUPPLIES.name] |= lowest
        targets[points.PLANTS.name] |= lowest
        others = {place.partition(".")[2]: bus for place, bus in places_of(peers).items()}
        buses = {name: node["bus"].value for name, node in nodes.nodes.items()}
        targets[points.WIRED.name] = {
            name: None for name, bus in ({**others, **buses}).items() if bus in wired.wired
        }
        self._sensors = targets[points.SENSORS.name]
        _check_faults(self._faults, targets, self._problems)
        held = {
            axis.name: each.usual
            for axis in axes.records
            for each in axis.influences
            if each.name == SUPPLY
        }
        _check_pressures(self._faults, held | dict(axes.supplies.usual), self._problems)
        defects = {axis.name: {each.name for each in axis.defects} for axis in axes.records}
        _check_defects(self._faults, defects | dict(axes.supplies.defects), self._problems)

    def build(self) -> dict[str, Any]:
        """Return the faults, and the units of the sensors that may have one."""
        faults = tuple(build_fault(fault) for fault in self._faults)
        return {"faults": FaultsPart(faults, self._sensors)}

    def tables(self) -> Iterable[Settings]:
        """Return the table of each fault."""
        return self._faults


def _read_faults(
    document: Document, overrides: Sequence[Mapping[str, object]], problems: Problems
) -> list[Settings]:
    """Return the settings of each fault of the file, then of those of the command line."""
    found = []
    for number, (given, origin, place) in enumerate(_find(document, overrides, problems), 1):
        table = f"faults[{number}]"
        if isinstance(given, dict):
            values = give(table, given, origin, problems)
            if origin is Origin.COMMAND_LINE:
                values = {
                    key: Given(value, origin, f"{place} {key}") for key, value in given.items()
                }
            found.append(_read_fault(table, values, problems))
        else:
            problems.add(place, f"{describe(given)} is not a table; write it as [[faults]]")
    return found


def _find_targets(nodes: Mapping[str, Settings], axes: Axes, bindings: Bindings) -> Targets:
    """Find the fault targets of a bench."""
    sensors: dict[str, Unit | None] = {}
    valves: dict[str, bool] = {}
    for name, node in nodes.items():
        kind = kind_of(node["profile"].value)
        signals = kind.signals(name, node)
        sensors |= {signal: UNITS.get(unit) for signal, unit in signals.items()}
        if kind.is_drive:
            valves[name] = kind.has_enable_input
        bound = bindings.get(name, ())
        sources = [each for each in bound if isinstance(each, SourceConfig)]
        sinks = [each for each in bound if isinstance(each, SinkConfig)]
        units = {
            f"{name}.{each.name}": UNITS.get(axes[each.axis].kind.by_name[each.quantity].unit)
            for each in sources
        }
        sensors |= units
        valves |= {f"{name}.{each.name}": False for each in sinks}
        if len(sources) == 1:
            sensors.setdefault(name, next(iter(units.values())))
        if len(sinks) == 1:
            valves.setdefault(name, False)
    lowest = {name: axis.kind.lowest_supply_bar(axis.settings) for name, axis in axes.items()}
    return {
        points.SENSORS.name: sensors,
        points.VALVES.name: dict.fromkeys(valves),
        points.ENABLES.name: {name: None for name, has_input in valves.items() if has_input},
        points.SUPPLIES.name: {name: low for name, low in lowest.items() if low is not None},
        points.PLANTS.name: dict.fromkeys(axes),
        points.NODES.name: dict.fromkeys(nodes),
    }


def _check_faults(faults: Sequence[Settings], targets: Targets, problems: Problems) -> None:
    """Note faults of what is not there, and amounts that are missing or in another unit."""
    for fault in faults:
        kind, target = find_fault_kind(fault["kind"].value), fault["target"].value
        check_effect(fault, problems)
        word, names = kind.find_targets(targets)
        if target not in names:
            right = f"give one of {', '.join(names)}" if names else "this bench has none"
            wrong = kind.find_lack(target, targets) or f"{quote(target)} is no {word}; {right}"
            problems.add(problems.place(fault["kind"].table, "target"), wrong)
        elif target in targets[points.SENSORS.name]:
            check_amount(fault, targets[points.SENSORS.name][target], problems)
        elif points.SUPPLIES in kind.groups and "pressure_bar" in fault:
            _check_pressure(fault, targets[points.SUPPLIES.name][target], problems)


def _check_defects(
    faults: Sequence[Settings], known: Mapping[str, set[str]], problems: Problems
) -> None:
    """Note faults of a plant, or of a supply, that it cannot have."""
    for fault in faults:
        kind, target = find_fault_kind(fault["kind"].value), fault["target"].value
        name = kind.defect({key: setting.value for key, setting in fault.items()})
        if name is not None and target in known and name not in known[target]:
            place = problems.place(fault["kind"].table, "kind")
            problems.add(place, missing_defect(kind, target, known[target]))


def build_fault(fault: Settings) -> FaultConfig:
    """Return the record of a checked fault."""
    given = [
        key
        for key in find_fault_kind(fault["kind"].value).keys
        if fault[key.name].value is not None
    ]
    return FaultConfig(**convert(fault, COMMON_KEYS), values=convert(fault, given))


def _find(
    document: Document, overrides: Sequence[Mapping[str, object]], problems: Problems
) -> Iterator[tuple[object, Origin, str]]:
    """Yield each fault with who gave it and how messages name its place."""
    tables = document.get("faults", [])
    if isinstance(tables, list):
        for number, table in enumerate(tables, 1):
            yield table, Origin.FILE, problems.place(f"faults[{number}]")
    else:
        right = "write each fault as [[faults]]"
        problems.add(problems.place("faults"), f"{describe(tables)} is no list; {right}")
    for override in overrides:
        name = " ".join(str(override[key]) for key in ("kind", "target") if key in override)
        yield override, Origin.COMMAND_LINE, f"--fault {name}"


def _read_fault(table: str, given: Mapping[str, Given], problems: Problems) -> Settings:
    kind = given.get("kind")
    try:
        keys = (*COMMON_KEYS, *find_fault_kind(kind.value if kind else None).keys)
    except ConfigError:
        # Which other keys are right depends on the kind, so the message about it must do.
        given = {"kind": kind} if kind else {}
        keys = (KIND_KEY,)
    return read_table(table, given, keys, problems)


def _check_pressures(
    faults: Sequence[Settings], usual: Mapping[str, float], problems: Problems
) -> None:
    """Note pressures of supplies that are not below their usual ones [Pa]."""
    for fault in faults:
        pressure = fault.get("pressure_bar")
        highest = BAR.from_si(usual.get(fault["target"].value, math.inf))
        if pressure is not None and pressure.value >= highest:
            wrong = f"{pressure.value:g} is not below the {highest:g} bar of the supply; give less"
            problems.add(problems.place(pressure.table, "pressure_bar"), wrong)


def _check_pressure(fault: Settings, tank: float, problems: Problems) -> None:
    pressure = fault["pressure_bar"]
    if pressure.value < tank:
        wrong = f"{pressure.value:g} is below tank_pressure_bar = {tank:g}"
        place = problems.place(pressure.table, "pressure_bar")
        problems.add(place, f"{wrong}; give that or more")


def check_effect(fault: Settings, problems: Problems, names: Collection[str] | None = None) -> None:
    """Note an amount with which a fault changes nothing.

    Args:
        fault: one of any kind.
        problems: to be noted.
        names: the keys to look at; None for all.
    """
    kind = find_fault_kind(fault["kind"].value)
    for key in kind.keys:
        value = fault[key.name].value
        if (names is None or key.name in names) and value is not None and kind.is_idle(key, value):
            wrong = f"{value:g} changes nothing; give another amount, or leave the fault out"
            problems.add(problems.place(fault["kind"].table, key.name), wrong)


def check_amount(fault: Settings, unit: Unit | None, problems: Problems) -> None:
    """Note where not the one amount is given that is in the unit of the sensor.

    Args:
        fault: one of a sensor.
        unit: that of the sensor's amounts; None where `[[faults]]` has no key for it.
        problems: to be noted.
    """
    kind, table = fault["kind"].value, fault["kind"].table
    amounts = [key.name for key in find_fault_kind(kind).amounts]
    if not amounts:
        return
    if unit is None:
        problems.add(
            problems.place(table, "kind"), f'"{kind}" is for pressures, positions and angles'
        )
        return
    (right,) = (name for name in amounts if unit.suffix in name)
    for name in amounts:
        if name != right and fault[name].value is not None:
            wrong = "is not what this sensor measures"
            problems.add(problems.place(table, name), f"{wrong}; give {right}")
            return
    if fault[right].value is None:
        problems.add(problems.place(table, right), f"missing; give {right} = 1, for example")
