"""The tables ``[plant.NAME]``: the axes, each with the kind of its plant."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hil_bench.bench.configuration.loop import LoopSection
from hil_bench.bench.configuration.plausibility import check_possible
from hil_bench.config.document import Document, Tables, read_named_sections
from hil_bench.config.settings import Given, Key, Origin, Problems, Settings, convert, read_table
from hil_bench.config.values import describe, quote, text
from hil_bench.errors import ConfigError, ParameterError
from hil_bench.plants.hydraulic_cylinder import keys as cylinder_keys
from hil_bench.plants.hydraulic_cylinder.configuration import (
    build_filter,
    explain_refusal,
    variable_pump,
)
from hil_bench.plants.hydraulic_cylinder.data_sheet.derive import fill
from hil_bench.plants.hydraulic_cylinder.data_sheet.oil import (
    EFFICIENCY,
    TEMPERATURE_C,
    Derived,
    Sheet,
    derive_pump,
    find_oil,
    known_oil,
)
from hil_bench.plants.hydraulic_cylinder.model.extensions import SupplyUnit
from hil_bench.plants.hydraulic_cylinder.model.stepping import Solver
from hil_bench.plants.hydraulic_cylinder.supply_group import Fed, SupplyConfig, find_exchange
from hil_bench.plants.hydraulic_cylinder.tank import TankConfig
from hil_bench.plants.plant import AxisConfig, AxisSettings, PlantKind
from hil_bench.plants.registry import DEFAULT_PLANT, PLANTS

# The tables ``[supply.NAME]``: supplies that several axes share.


TABLE = "supply"

_OWN = ("bulk_modulus_mpa", "oil", "oil_viscosity_mm2_s")
"""The keys of a supply that an axis has for itself too."""
_HEATED = "oil_temperature_c"
"""The key that no axis has whose supply has a tank: its values hold at 40 °C."""


class SuppliesSection:
    """The supplies that axes share.

    Args:
        document: the file.
        loop: with the tick and the step of the plants' solvers.
        problems: where problems are noted.
    """

    def __init__(self, document: Document, loop: LoopSection, problems: Problems) -> None:
        self._loop, self._problems = loop, problems
        self._supplies: dict[str, Settings] = {}
        for name, settings in (
            Tables(document, problems).named(TABLE, cylinder_keys.SHARED_KEYS).items()
        ):
            if len(settings) == len(cylinder_keys.SHARED_KEYS):
                sheet = Sheet(settings, problems)
                derived = [*sheet.take(derive_pump(sheet)), *sheet.take(_derive_viscosity(sheet))]
                settings.update({each.key: fill(settings, each) for each in derived})
            self._supplies[name] = settings
        self._fed: dict[str, list[str]] = {name: [] for name in self._supplies}
        self._records: list[SupplyConfig] = []

    def lend(self, axis: str, kind: PlantKind[Any], settings: Settings) -> Settings:
        """Return the settings of an axis with those of the supply that it names.

        What it says of a supply that is not its own is noted.
        """
        name = kind.supply_of(settings)
        if not name:
            return settings
        table, problems = f"plant.{axis}", self._problems
        if name not in self._supplies:
            known = ['"constant"', '"unit"', *map(quote, self._supplies)]
            wrong = f"{quote(name)} is unknown; give {', '.join(known[:-1])} or {known[-1]}"
            problems.add(problems.place(table, cylinder_keys.SUPPLY_KEY.name), wrong)
            return settings
        self._fed[name].append(axis)
        lent = {}
        for key in cylinder_keys.SHARED_KEYS:
            if key.name in _OWN or key.name not in settings:
                continue
            if settings[key.name].origin is not Origin.DEFAULT:
                right = f"give it in [{TABLE}.{name}]"
                problems.add(problems.place(table, key.name), f"belongs to the supply; {right}")
            given = self._supplies[name].get(key.name)
            if given is not None and key not in cylinder_keys.PUMP_SHEET:
                reason = f"from {TABLE}.{name}"
                lent[key.name] = settings[key.name]._replace(
                    value=given.value, origin=Origin.DATA_SHEET, reason=reason
                )
        tank = self._supplies[name].get("tank_volume_l")
        if tank is not None and tank.value is not None and settings[_HEATED].value is not None:
            right = f"leave it out, and give start_temperature_c in [{TABLE}.{name}]"
            problems.add(problems.place(table, _HEATED), f"belongs to the supply's tank; {right}")
        return settings | lent

    def connect(self, axes: Sequence[AxisConfig]) -> None:
        """Make the records, with the axes that the supplies feed, and note what makes no sense."""
        by_name = {axis.name: axis for axis in axes}
        for name, settings in self._supplies.items():
            check_possible(settings, DEFAULT_PLANT, self._problems)
            place = self._problems.place(f"{TABLE}.{name}")
            if not self._fed[name]:
                right = f'give an axis supply = "{name}"'
                self._problems.add(place, f"no axis draws from it; {right}")
            if name in by_name:
                self._problems.add(place, "is the name of an axis; give another name")
            fed = [by_name[axis] for axis in self._fed[name] if axis in by_name]
            self._connect(name, settings, [axis for axis in fed if isinstance(axis, Fed)])

    def _connect(self, name: str, settings: Settings, axes: Sequence[Fed]) -> None:
        for axis in axes:
            if axis.cylinder.solver is not Solver.LINEARLY_IMPLICIT_MIDPOINT:
                place = self._problems.place(f"plant.{axis.name}", "solver")
                right = f'give solver = "{Solver.LINEARLY_IMPLICIT_MIDPOINT.value}"'
                self._problems.add(place, f"cannot share a supply; {right}")
                return
        try:
            tank = self._read_tank(name, settings)
            record = _build_record(name, settings, axes, tank)
            if axes:
                dt, steps = self._loop.step_us * 1e-6, self._loop.steps_per_tick
                record = record.exchanged(find_exchange(record, axes, dt, steps))
        except ParameterError as error:
            explain_refusal(f"{TABLE}.{name}", error, self._problems)
            return
        self._records.append(record)

    def _read_tank(self, name: str, settings: Settings) -> TankConfig | None:
        """Return the tank of a supply; None for oil that stays as it is."""
        sheet = Sheet(settings, self._problems)
        oil = find_oil(sheet) if sheet.has("oil") else None
        if not sheet.has("tank_volume_l"):
            return None
        if oil is None:
            if not sheet.has("oil"):
                right = 'give for example oil = "HLP 46"'
                place = self._problems.place(f"{TABLE}.{name}", "oil")
                self._problems.add(place, f"missing; tank_volume_l is given and needs it; {right}")
            return None
        losses = "pump_efficiency_percent", "pump_volumetric_efficiency_percent"
        efficiency, volumetric = sheet.si(losses[0]), sheet.si(losses[1], EFFICIENCY)
        if sheet.has(*losses) and efficiency > volumetric:
            wrong = (
                f"{sheet.number(losses[0]):g} is above {losses[1]} = {sheet.number(losses[1]):g}"
            )
            sheet.refuse(losses[0], f"{wrong}, which is a part of it; give that or less")
        # The leakage of a pump that swivels is a constant of its own.
        volumetric = 1.0 if variable_pump(settings) else volumetric
        given = {**convert(settings, cylinder_keys.TANK_KEYS), "oil": oil, "volumetric": volumetric}
        return TankConfig(**given)

    def resolve(self) -> None:
        """Do nothing: the axes connect the supplies."""

    def build(self) -> dict[str, Any]:
        """Return the records of the supplies."""
        return {"supplies": tuple(self._records)}

    def tables(self) -> Iterable[Settings]:
        """Return the table of each supply."""
        return self._supplies.values()

    @property
    def defects(self) -> Mapping[str, set[str]]:
        """The possible defects of each supply, by its name."""
        return {each.name: {defect.name for defect in each.defects} for each in self._records}

    @property
    def usual(self) -> Mapping[str, float]:
        """The pressure of each supply without a fault [Pa], by its name."""
        return {each.name: each.held.usual for each in self._records}

    @property
    def lowest_bar(self) -> dict[str, float]:
        """The pressure of each supply's tank [bar]."""
        return {
            name: float(settings["tank_pressure_bar"].value)
            for name, settings in self._supplies.items()
        }


def _derive_viscosity(sheet: Sheet) -> Iterator[Derived]:
    """Yield the viscosity of a supply's oil; at 40 °C where a tank changes its temperature."""
    oil = known_oil(sheet)
    if oil is not None:
        warm = TEMPERATURE_C if sheet.has("tank_volume_l") else sheet.number("start_temperature_c")
        yield Derived(
            "oil_viscosity_mm2_s", oil.viscosity_at(warm), ("oil",), f"at {warm:g} °C", yields=True
        )


def _build_record(
    name: str, settings: Settings, axes: Sequence[Fed], tank: TankConfig | None
) -> SupplyConfig:
    unit = SupplyUnit(
        **convert(settings, cylinder_keys.SUPPLY_KEYS),
        variable=variable_pump(settings),
        filter=build_filter(settings),
    )
    names = ("bulk_modulus_mpa", "supply_pressure_bar", "tank_pressure_bar", "start_temperature_c")
    keys = tuple(settings[each].key for each in names)
    modulus, pressure, tank_pressure, temperature = convert(settings, keys).values()
    return SupplyConfig(
        name,
        unit,
        modulus,
        pressure,
        tank_pressure,
        tuple(axis.name for axis in axes),
        temperature=temperature,
        tank=tank,
    )


KIND_KEY = Key("kind", text)

NO_PLANT = "none"
"""The kind of a plant that is none: the bench has nodes alone."""

_DEFAULT_AXIS = "axis1"


Axes = Mapping[str, AxisSettings]
"""By name."""


class AxesSection:
    """The plants of a bench.

    Args:
        document: the file.
        loop: with the step of the plants' solvers.
        supplies: those that axes share.
        folder: that relative paths in the file start from.
        problems: where problems are noted.
        default: whether a file without a plant has one default axis; else it has none.

    Attributes:
        supplies: as passed in.
        axes: the table of each axis by its name; one of a kind that is not there is left out.
        records: those of the axes that make physical sense; known once it is resolved.
    """

    def __init__(
        self,
        document: Document,
        loop: LoopSection,
        supplies: SuppliesSection,
        folder: Path,
        problems: Problems,
        *,
        default: bool,
    ) -> None:
        self.axes = _read_axes(document, supplies, folder, problems, default=default)
        self.records: tuple[AxisConfig, ...] = ()
        self._loop, self._problems, self.supplies = loop, problems, supplies

    def resolve(self) -> None:
        """Make the records, and note values that nature does not allow."""
        records = []
        for name, axis in self.axes.items():
            check_possible(axis.settings, axis.kind, self._problems)
            records.append(
                axis.kind.configure(name, axis.settings, self._loop.step_us, self._problems)
            )
        self.records = tuple(record for record in records if record is not None)
        self.supplies.connect(self.records)

    def build(self) -> dict[str, Any]:
        """Return the records of the axes."""
        return {"axes": self.records}

    def tables(self) -> Iterable[Settings]:
        """Return the table of each axis."""
        return (axis.settings for axis in self.axes.values())


def _read_axes(
    document: Document,
    supplies: SuppliesSection,
    folder: Path,
    problems: Problems,
    *,
    default: bool,
) -> dict[str, AxisSettings]:
    sections = read_named_sections(document, "plant", problems)
    if default and not sections:
        sections = {_DEFAULT_AXIS: {}}
    axes = {}
    for name, given in sections.items():
        table = f"plant.{name}"
        if KIND_KEY.name in given and given[KIND_KEY.name].value == NO_PLANT:
            _check_nothing(given, problems)
            continue
        told = {KIND_KEY.name: given.pop(KIND_KEY.name)} if KIND_KEY.name in given else {}
        kind = _find_kind(told, problems)
        if kind is not None:
            said = read_table(table, told, (KIND_KEY,), problems) if told else {}
            settings = read_table(table, given, kind.keys, problems)
            if len(settings) == len(kind.keys):
                settings = kind.derive(supplies.lend(name, kind, settings), problems)
                special = kind.specialise(settings, folder, problems)
                if special is None:
                    problems.raise_any()  # without its quantities nothing else can be checked
                kind = special or kind
            axes[name] = AxisSettings(kind, said | settings)
    return axes


def _check_nothing(given: Mapping[str, Given], problems: Problems) -> None:
    """Note what is said of a plant that is none."""
    for key, (_, _, place) in given.items():
        if key != KIND_KEY.name:
            problems.add(
                place, f'there is no plant to have it; leave it out, or kind = "{NO_PLANT}"'
            )


def _find_kind(told: Mapping[str, Given], problems: Problems) -> PlantKind[Any] | None:
    if not told:
        return DEFAULT_PLANT
    given = told[KIND_KEY.name]
    try:
        kind = PLANTS.find(given.value) if isinstance(given.value, str) else None
    except ConfigError as error:
        problems.add(given.place, error)
        return None
    if kind is None:
        known = ", ".join(f'"{name}"' for name in (*PLANTS.names(), NO_PLANT))
        problems.add(given.place, f"{describe(given.value)} is unknown; give one of {known}")
    return kind
