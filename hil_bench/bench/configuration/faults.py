"""The tables ``[[faults]]``: what goes wrong by itself, and when."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any

from hil_bench.bench.configuration.axes import Axes, AxesSection
from hil_bench.bench.configuration.buses import BusesSection
from hil_bench.bench.configuration.nodes import Bindings
from hil_bench.bench.configuration.nodes_section import NodesSection
from hil_bench.bench.configuration.peers import PeerSections, places_of
from hil_bench.bench.configuration.records import FaultConfig
from hil_bench.config.document import Document
from hil_bench.config.settings import Given, Origin, Problems, Settings, convert, give, read_table
from hil_bench.config.values import describe, quote
from hil_bench.devices.faults.kind import UNITS
from hil_bench.devices.faults.points import ENABLES, NODES, PLANTS, SENSORS, SUPPLIES, VALVES, WIRED
from hil_bench.devices.faults.registry import COMMON_KEYS, KIND_KEY, find_fault_kind, missing_defect
from hil_bench.errors import ConfigError
from hil_bench.kinds.bindings import SinkConfig, SourceConfig
from hil_bench.kinds.registry import kind_of
from hil_bench.units import Unit

Targets = dict[str, dict[str, Any]]
"""The names of the targets that may have faults, by group.

Of sensors with the unit of their amounts, None where `[[faults]]` has no key for it; of supplies
with the least pressure [bar].
"""


class FaultsSection:
    """The faults of the file, then those of the command line.

    Args:
        document: the file.
        overrides: tables of the command line.
        nodes: whose devices may have faults.
        axes: whose plants may, and the supplies that they share.
        buses: those that are of copper may.
        peers: the devices beside the nodes.
        problems: where problems are noted.
    """

    def __init__(
        self,
        document: Document,
        overrides: Sequence[Mapping[str, object]],
        nodes: NodesSection,
        axes: AxesSection,
        buses: BusesSection,
        peers: PeerSections,
        problems: Problems,
    ) -> None:
        self._peers = peers
        self._faults = _read_faults(document, overrides, problems)
        self._nodes, self._axes, self._problems = nodes, axes, problems
        self._buses, self._supplies = buses, axes.supplies
        self._sensors: Mapping[str, Unit | None] = {}

    def resolve(self) -> None:
        """Note faults of what the bench does not have."""
        targets = _find_targets(self._nodes.nodes, self._axes.axes, self._nodes.bindings)
        for section in self._peers.values():
            for group, found in section.fault_targets().items():
                targets.setdefault(group, {}).update(found)
        lowest = self._supplies.lowest_bar
        targets[SUPPLIES.name] |= lowest
        targets[PLANTS.name] |= lowest
        others = {place.partition(".")[2]: bus for place, bus in places_of(self._peers).items()}
        buses = {name: node["bus"].value for name, node in self._nodes.nodes.items()}
        targets[WIRED.name] = {
            name: None for name, bus in ({**others, **buses}).items() if bus in self._buses.wired
        }
        self._sensors = targets[SENSORS.name]
        _check_faults(self._faults, targets, self._problems)
        defects = {axis.name: {each.name for each in axis.defects} for axis in self._axes.records}
        _check_defects(self._faults, defects | dict(self._supplies.defects), self._problems)

    def build(self) -> dict[str, Any]:
        """Return the records of the faults, and the units of the sensors that may have one."""
        faults = tuple(build_fault(fault) for fault in self._faults)
        return {"faults": faults, "sensor_units": self._sensors}

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
        SENSORS.name: sensors,
        VALVES.name: dict.fromkeys(valves),
        ENABLES.name: {name: None for name, has_input in valves.items() if has_input},
        SUPPLIES.name: {name: low for name, low in lowest.items() if low is not None},
        PLANTS.name: dict.fromkeys(axes),
        NODES.name: dict.fromkeys(nodes),
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
        elif target in targets[SENSORS.name]:
            check_amount(fault, targets[SENSORS.name][target], problems)
        elif SUPPLIES in kind.groups and "pressure_bar" in fault:
            _check_pressure(fault, targets[SUPPLIES.name][target], problems)


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
