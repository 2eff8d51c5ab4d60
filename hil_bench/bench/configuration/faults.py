"""The tables ``[[faults]]``: what goes wrong by itself, and when."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from hil_bench.bench.configuration.axes import Axes, AxesSection
from hil_bench.bench.configuration.buses import BusesSection
from hil_bench.bench.configuration.ecus import EcusSection
from hil_bench.bench.configuration.fault_keys import (
    COMMON_KEYS,
    KIND_KEY,
    OWN_KEYS,
    idle_value,
)
from hil_bench.bench.configuration.nodes import Bindings
from hil_bench.bench.configuration.nodes_section import NodesSection
from hil_bench.bench.configuration.records import FaultConfig
from hil_bench.config.document import Document, give
from hil_bench.config.settings import Given, Origin, Problems, Settings, convert, read_table
from hil_bench.config.values import describe, quote
from hil_bench.devices.faults.checks import missing_defect
from hil_bench.devices.faults.kinds import (
    DEFECT_KINDS,
    DEFECTS,
    ECU_KINDS,
    LEAKS,
    SENSOR_KINDS,
    VALVE_KINDS,
    WIRE_KINDS,
    FaultKind,
)
from hil_bench.kinds.auxiliary_valve import FLOW
from hil_bench.kinds.bindings import SinkConfig, SourceConfig
from hil_bench.kinds.registry import kind_of
from hil_bench.plants.kind import AxisConfig
from hil_bench.units import BAR, DEGREE, MILLIMETRE, ONE, PERCENT, Unit, si_unit

_UNITS = {"Pa": BAR, "m": MILLIMETRE, "rad": DEGREE, "-": PERCENT}
"""In which the keys of `[[faults]]` give amounts, by the SI unit of what a sensor measures."""


class FaultTargets(NamedTuple):
    """The targets that may have faults, by name.

    Attributes:
        sensors: with the unit of their amounts; None where `[[faults]]` has no key for it.
        valves: with whether they have an enable input.
        axes: those with a supply, with the least pressure that it can have [bar].
        nodes: names.
        plants: names of all axes.
        ecus: names of the J1939 devices.
        signals: what these send.
    """

    sensors: Mapping[str, Unit | None]
    valves: Mapping[str, bool]
    axes: Mapping[str, float]
    nodes: Sequence[str]
    plants: Sequence[str] = ()
    ecus: Sequence[str] = ()
    signals: Sequence[str] = ()

    def of(self, kind: FaultKind) -> tuple[str, Sequence[str]]:
        """List the targets that a fault kind accepts: the word for them, and their names."""
        if kind is FaultKind.DISABLE:
            names = [name for name, has_input in self.valves.items() if has_input]
            return "valve with an enable input", names
        special: dict[FaultKind, tuple[str, Sequence[str]]] = {
            FaultKind.SLOW: ("sensor or valve", [*self.sensors, *self.valves]),
            FaultKind.DROP_SUPPLY: ("axis", list(self.axes)),
            FaultKind.INDICATE: ("J1939 signal", self.signals),
            **dict.fromkeys(SENSOR_KINDS, ("sensor", list(self.sensors))),
            **dict.fromkeys(VALVE_KINDS, ("valve", list(self.valves))),
            **dict.fromkeys(DEFECT_KINDS, ("axis", self.plants)),
        }
        whole = ("J1939 device", self.ecus) if kind in ECU_KINDS else ("node", self._all_nodes)
        return special.get(kind, whole)

    @property
    def _all_nodes(self) -> list[str]:
        return [*self.nodes, *self.ecus]


class FaultsSection:
    """The faults of the file, then those of the command line.

    Args:
        document: the file.
        overrides: tables of the command line.
        nodes: whose devices may have faults.
        axes: whose plants may, and the supplies that they share.
        buses: those that are of copper may.
        ecus: J1939 devices, which may.
        problems: where problems are noted.
    """

    def __init__(
        self,
        document: Document,
        overrides: Sequence[Mapping[str, object]],
        nodes: NodesSection,
        axes: AxesSection,
        buses: BusesSection,
        ecus: EcusSection,
        problems: Problems,
    ) -> None:
        self._ecus = ecus
        self._faults = _read_faults(document, overrides, problems)
        self._nodes, self._axes, self._problems = nodes, axes, problems
        self._buses, self._supplies = buses, axes.supplies
        self._sensors: Mapping[str, Unit | None] = {}

    def resolve(self) -> None:
        """Note faults of what the bench does not have."""
        targets = _find_targets(self._nodes.nodes, self._axes.axes, self._nodes.bindings)
        targets = _add_ecus(targets, self._ecus)
        lowest = self._supplies.lowest_bar
        targets = targets._replace(
            axes={**targets.axes, **lowest}, plants=[*targets.plants, *lowest]
        )
        self._sensors = targets.sensors
        _check_faults(self._faults, targets, self._problems)
        self._check_wires()
        _check_defects(self._faults, self._axes.records, self._supplies.defects, self._problems)

    def _check_wires(self) -> None:
        """Note faults of copper on a bus that takes no time."""
        for fault in self._faults:
            node = self._nodes.nodes.get(fault["target"].value)
            bus = self._ecus.buses.get(fault["target"].value) if node is None else node["bus"].value
            is_of_wire = fault["kind"].value in WIRE_KINDS
            if is_of_wire and bus is not None and bus not in self._buses.wired:
                place = self._problems.place(fault["kind"].table, "target")
                name = fault["target"].value
                wrong = f"the bus of {name} takes no time; give it [bus.wire]"
                self._problems.add(place, wrong)

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


def _find_targets(nodes: Mapping[str, Settings], axes: Axes, bindings: Bindings) -> FaultTargets:
    """Find the fault targets of a bench."""
    sensors: dict[str, Unit | None] = {}
    valves: dict[str, bool] = {}
    for name, node in nodes.items():
        kind = kind_of(node["profile"].value)
        signals = kind.signals(name, node)
        sensors |= {signal: _UNITS.get(unit) for signal, unit in signals.items()}
        if kind.is_drive:
            valves[name] = kind.has_enable_input
        bound = bindings.get(name, ())
        sources = [each for each in bound if isinstance(each, SourceConfig)]
        sinks = [each for each in bound if isinstance(each, SinkConfig)]
        units = {
            f"{name}.{each.name}": _UNITS.get(axes[each.axis].kind.by_name[each.quantity].unit)
            for each in sources
        }
        sensors |= units
        valves |= {f"{name}.{each.name}": False for each in sinks}
        if len(sources) == 1:
            sensors.setdefault(name, next(iter(units.values())))
        if len(sinks) == 1:
            valves.setdefault(name, False)
    lowest = {name: axis.kind.lowest_supply_bar(axis.settings) for name, axis in axes.items()}
    supplies = {name: pressure for name, pressure in lowest.items() if pressure is not None}
    return FaultTargets(sensors, valves, supplies, list(nodes), list(axes))


def _add_ecus(targets: FaultTargets, ecus: EcusSection) -> FaultTargets:
    """Return the targets with those of J1939 devices."""
    sensors, valves, signals = dict(targets.sensors), dict(targets.valves), []
    for device, given in ecus.signals.items():
        for signal in given:
            name = f"{device}.{signal.name}"
            if signal.is_sink:
                valves[name] = False
                continue
            signals.append(name)
            if signal.word != "follow":
                own = si_unit(signal.settings["unit"].value or ONE.symbol)[0]
                unit = signal.quantity.unit if signal.quantity is not None else own
                sensors[name] = _UNITS.get(unit)
    for drive in ecus.drives():
        if drive.device is not None:
            valves[drive.device] = False
            sensors[f"{drive.device}.{FLOW.name}"] = PERCENT
    names = list(ecus.devices)
    return targets._replace(sensors=sensors, valves=valves, ecus=names, signals=signals)


def _check_faults(faults: Sequence[Settings], targets: FaultTargets, problems: Problems) -> None:
    """Note faults of what is not there, and amounts that are missing or in another unit."""
    for fault in faults:
        kind, target = fault["kind"].value, fault["target"].value
        table = fault["kind"].table
        check_effect(fault, problems)
        what, names = targets.of(kind)
        if target not in names:
            right = f"give one of {', '.join(names)}" if names else "this bench has none"
            place = problems.place(table, "target")
            problems.add(place, f"{quote(target)} is no {what}; {right}")
        elif kind in SENSOR_KINDS:
            check_amount(fault, targets.sensors[target], problems)
        elif kind is FaultKind.DROP_SUPPLY:
            _check_pressure(fault, targets.axes[target], problems)


def _check_defects(
    faults: Sequence[Settings],
    axes: Sequence[AxisConfig],
    supplies: Mapping[str, set[str]],
    problems: Problems,
) -> None:
    """Note faults of a plant, or of a supply, that it cannot have."""
    known = {axis.name: {defect.name for defect in axis.defects} for axis in axes} | dict(supplies)
    for fault in faults:
        kind, target = fault["kind"].value, fault["target"].value
        if kind in DEFECT_KINDS and target in known:
            name = LEAKS[fault["path"].value] if kind is FaultKind.LEAK else DEFECTS[kind]
            if name not in known[target]:
                place = problems.place(fault["kind"].table, "kind")
                problems.add(place, f"{target} {missing_defect(name)}")


def build_fault(fault: Settings) -> FaultConfig:
    """Return the record of a checked fault."""
    kind = fault["kind"].value
    common = convert(fault, COMMON_KEYS)
    values: dict[str, Any] = {}
    for key in OWN_KEYS[kind]:
        if fault[key.name].value is not None:
            values |= convert(fault, (key,))
    return FaultConfig(**common, values=values)


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
        keys = (*COMMON_KEYS, *OWN_KEYS[FaultKind(str(kind.value if kind else None))])
    except ValueError:
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
    for key in OWN_KEYS[fault["kind"].value]:
        value = fault[key.name].value
        if (names is None or key.name in names) and value is not None and value == idle_value(key):
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
    amounts = [key.name for key in OWN_KEYS[kind] if key.name.startswith(f"{kind}_")]
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
