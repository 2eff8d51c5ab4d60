"""The table ``[plant.NAME]`` of a cylinder and the hydraulic side of its valve."""

import math
from dataclasses import dataclass, replace
from typing import Any

from hil_bench.config.settings import Origin, Problems, Settings, convert
from hil_bench.errors import ConfigError, ParameterError
from hil_bench.plants.hydraulic_cylinder import keys as cylinder_keys
from hil_bench.plants.hydraulic_cylinder.keys import build_lines
from hil_bench.plants.hydraulic_cylinder.model.checks import (
    check_components,
    check_full_model,
    check_lines,
)
from hil_bench.plants.hydraulic_cylinder.model.defects import MOST_AIR
from hil_bench.plants.hydraulic_cylinder.model.extensions import (
    CounterbalanceValve,
    Cushion,
    EntrainedAir,
    Filter,
    LuGreFriction,
    MeteringLands,
    SupplyUnit,
    VariablePump,
)
from hil_bench.plants.hydraulic_cylinder.model.load import (
    ConstantLoad,
    Load,
    LoadSeries,
    MassOnSlope,
    SpringLoad,
)
from hil_bench.plants.hydraulic_cylinder.model.models import Model, largest_stable_step
from hil_bench.plants.hydraulic_cylinder.model.options import EndStop, PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.reduced_order import (
    check_delay,
    check_reduced_model,
    check_reduced_rest,
)
from hil_bench.plants.hydraulic_cylinder.model.stepping import LOAD_LIMIT, Solver, shortcoming
from hil_bench.plants.hydraulic_cylinder.model.validation import require_positive
from hil_bench.plants.hydraulic_cylinder.quantities import LOAD, POSITION
from hil_bench.plants.plant import SUPPLY, AxisConfig, Influence, PlantKind

_SUPPLY_LIMIT = 1e9  # [Pa], ten times that of a water jet cutter

_LARGEST_LEAK = 5e-3 / 60.0 / 1e5  # [m³/(s Pa)], 5 l/min a bar: a hose that has burst
_MOST_WORN = 5e-4  # [m], a spool that hardly closes
_DEFECTS = (
    Influence("internal_leakage", "m³/(s Pa)", 0.0, _LARGEST_LEAK),
    Influence("leakage_a", "m³/(s Pa)", 0.0, _LARGEST_LEAK),
    Influence("leakage_b", "m³/(s Pa)", 0.0, _LARGEST_LEAK),
    Influence("entrained_air", "-", 0.0, MOST_AIR),
    Influence("null_opening", "m", 0.0, _MOST_WORN),
    Influence("dry_friction", "N", 0.0, LOAD_LIMIT),
)
_LOAD_DEFECTS = (Influence("load_loss", "-", 0.0, 1.0),)
_SUPPLY_DEFECTS = (
    Influence("pump_loss", "-", 0.0, 1.0),
    Influence("relief_sag", "Pa", 0.0, _SUPPLY_LIMIT),
    Influence("gas_loss", "-", 0.0, 1.0),
)
_FILTER_DEFECTS = (Influence("filter_clogging", "-", 0.0, 1.0),)

_NAMED_APART = {
    "position",
    *(
        key.field
        for key in (*cylinder_keys.CUSHION_KEYS["cushion_a"], *cylinder_keys.WALL_KEYS["a"])
    ),
}
_KEYS_OF_SYMBOLS = {
    **{key.name: key.name for key in cylinder_keys.AXIS_KEYS},
    **{
        key.field: key.name
        for key in cylinder_keys.AXIS_KEYS
        if key.field not in {"", *_NAMED_APART}
    },
    "bristles": "friction",
    "supply_unit": "supply",
    "lands": "flow_saturation",
    "the cushion": "cushion_a_length_mm",
    "line_a": "line_a_length_m",
    "line_b": "line_b_length_m",
    "lines": "line_model",
}
"""The key of each symbol that `ParameterError` names."""


@dataclass(frozen=True, slots=True)
class CylinderConfig(AxisConfig):
    """A cylinder and the hydraulic side of its valve.

    Attributes:
        model: which of the paper's.
        parameters: the model's parameters.
        options: what the paper leaves open.
        solver: the integration method.
        position: piston position at the start, from mid-stroke, positive when extending [m].
        spool_delay: what stands for the spool's lag in the reduced model [s].
        is_fed: whether it shares its supply with others; the options then have the whole unit.
    """

    model: Model
    parameters: PlantParameters
    options: PlantOptions
    solver: Solver
    position: float
    spool_delay: float
    is_fed: bool = False

    @property
    def has_own_unit(self) -> bool:
        """True where a supply unit of its own feeds it."""
        return self.options.supply is not None and not self.is_fed

    @property
    def cylinder(self) -> "CylinderConfig":
        """The cylinder of the equations: the axis itself."""
        return self

    def fed_by(self, unit: SupplyUnit) -> "CylinderConfig":
        """Return the axis with another supply unit."""
        return replace(self, options=replace(self.options, supply=unit))

    @property
    def full_scale(self) -> float:
        """The spool position from which on the orifices are fully open [m]."""
        return self.parameters.full_opening

    @property
    def influences(self) -> tuple[Influence, ...]:
        """A load on the piston, and a supply pressure not below that of the tank."""
        return (
            Influence(LOAD, "N", -LOAD_LIMIT, LOAD_LIMIT),
            held_supply(self.parameters.P_T, self.parameters.P_S, self.options.supply),
        )

    @property
    def defects(self) -> tuple[Influence, ...]:
        """The defects that the full model supports, stepped by the bench's own solver."""
        if self.model is Model.REDUCED or self.solver is not Solver.LINEARLY_IMPLICIT_MIDPOINT:
            return ()
        return (
            *_DEFECTS,
            *(_LOAD_DEFECTS if self.options.loads else ()),
            *(() if self.is_fed else supply_defects(self.options.supply)),
        )

    def limits(self, quantity: str) -> tuple[float, float]:
        """Return the ends of the stroke for the piston's position [m], else no limits."""
        half = self.parameters.h if quantity == POSITION.name else math.inf
        return -half, half


def held_supply(tank: float, pressure: float, unit: SupplyUnit | None) -> Influence:
    """Return the influence of a supply pressure that is held.

    Args:
        tank: pressure of the tank [Pa], the lowest.
        pressure: of the supply [Pa]; of a unit, at the start.
        unit: it; None for a constant pressure.
    """
    usual = pressure if unit is None else max(pressure, unit.relief_pressure)
    return Influence(SUPPLY, "Pa", tank, _SUPPLY_LIMIT, usual)


def supply_defects(unit: SupplyUnit | None) -> tuple[Influence, ...]:
    """Return the defects of a supply unit; empty without a unit."""
    if unit is None:
        return ()
    return _SUPPLY_DEFECTS if unit.filter is None else (*_SUPPLY_DEFECTS, *_FILTER_DEFECTS)


def configure(
    kind: PlantKind["CylinderConfig"],
    name: str,
    settings: Settings,
    step_us: int,
    problems: Problems,
) -> CylinderConfig | None:
    """Return the record of an axis; what makes no physical sense is noted, and None returned."""
    _check_position(name, settings, problems)
    try:
        record = build_axis(kind, name, settings)
        check_lines(record.parameters, record.options, step_us * 1e-6)
    except ParameterError as error:
        explain_refusal(f"plant.{name}", error, problems)
        return None
    _check_solver(record, step_us, problems)
    return record


def require_cylinder(axis: AxisConfig, who: str) -> CylinderConfig:
    """Return an axis that is a cylinder.

    Raises:
        ConfigError: it is another plant, and `who` needs a cylinder.
    """
    if not isinstance(axis, CylinderConfig):
        wrong = f"is a {axis.kind.name}, and {who} needs a hydraulic cylinder"
        raise ConfigError(f"plant.{axis.name}: {wrong}; give it an axis that is one")
    return axis


def full_opening_mm(axis: Settings) -> float:
    """Return the spool position [mm] from which on the orifices of an axis are fully open.

    It is alpha + beta (Ruderman 2017 eq. (2)), of the larger side.
    """
    alpha, beta = axis["orifice_full_opening_mm"].value, axis["spool_overlap_mm"].value
    alpha_negative = axis["orifice_full_opening_negative_mm"].value
    beta_negative = axis["spool_overlap_negative_mm"].value
    negative = (alpha if alpha_negative is None else alpha_negative) + (
        beta if beta_negative is None else beta_negative
    )
    return float(max(alpha + beta, negative))


def build_axis(kind: PlantKind["CylinderConfig"], name: str, axis: Settings) -> CylinderConfig:
    """Return the record of an axis.

    Raises:
        ParameterError: it makes no physical sense.
    """
    record = CylinderConfig(
        name=name,
        kind=kind,
        model=axis["model"].value,
        parameters=PlantParameters(**convert(axis, cylinder_keys.PARAMETER_KEYS)),
        options=_build_options(axis),
        solver=axis["solver"].value,
        position=convert(axis, (axis["position_mm"].key,))["position"],
        spool_delay=convert(axis, (cylinder_keys.DELAY_KEY,))["delay"],
        is_fed=axis["supply"].value not in set(cylinder_keys.Supply),
    )
    if record.model is Model.REDUCED:
        check_reduced_model(record.parameters, record.options)
        check_delay(record.spool_delay)
        check_reduced_rest(record.parameters, record.options, record.position)
    elif record.spool_delay:
        raise ParameterError(
            f'delay = {record.spool_delay:g} s: only for model = "reduced"', "delay"
        )
    else:
        check_full_model(record.parameters, record.options)
        check_components(record.options, record.solver)
    return record


def _build_options(axis: Settings) -> PlantOptions:
    options = convert(axis, cylinder_keys.OPTION_KEYS) | hydraulic_options(axis)
    options |= {end: _build_cushion(axis, end) for end in cylinder_keys.CUSHION_KEYS}
    options["counterbalance"] = _build_counterbalance(axis)
    options |= build_lines(axis)
    pump = _build_pump(axis)
    if pump is not None:
        options["supply"] = replace(options["supply"], variable=pump)
    if axis["end_stop"].value:
        options["end_stop"] = EndStop(**convert(axis, cylinder_keys.END_STOP_KEYS))
    if axis["friction"].value is cylinder_keys.Friction.LUGRE:
        options["bristles"] = LuGreFriction(**convert(axis, cylinder_keys.BRISTLE_KEYS))
    return PlantOptions(**options, loads=_build_loads(axis))


def hydraulic_options(axis: Settings) -> dict[str, Any]:
    """Return the options of oil, valve and supply that the keys of an axis ask for.

    Raises:
        ParameterError: a filter lacks its data, or a supply that has one.
    """
    options: dict[str, Any] = convert(axis, (cylinder_keys.COMPENSATOR_KEY,))
    if axis["cavitation"].value:
        options |= convert(axis, cylinder_keys.CAVITATION_KEYS)
    if axis["entrained_air_percent"].value:
        options["air"] = EntrainedAir(**convert(axis, cylinder_keys.AIR_KEYS))
    lands = MeteringLands(**convert(axis, cylinder_keys.LAND_KEYS))
    if lands != MeteringLands():
        options["lands"] = lands
    element = build_filter(axis)
    if axis["supply"].value is not cylinder_keys.Supply.CONSTANT:
        options["supply"] = SupplyUnit(**convert(axis, cylinder_keys.SUPPLY_KEYS), filter=element)
    elif element is not None:
        right = 'give supply = "unit" too'
        raise ParameterError(
            f"a constant supply has no filter: {right}", cylinder_keys.FILTER_RATING[0].name
        )
    return options


def build_filter(settings: Settings) -> Filter | None:
    """Return the filter of a supply; None without one.

    Raises:
        ParameterError: its data are missing or make no sense.
    """
    missing = [key.name for key in cylinder_keys.FILTER_RATING if settings[key.name].value is None]
    written = [
        key.name
        for key in cylinder_keys.FILTER_KEYS
        if key.default is None
        and settings[key.name].origin not in {Origin.DEFAULT, Origin.DATA_SHEET}
    ]
    if missing and written:
        raise ParameterError(f"a filter needs its data: give {missing[0]} too", written[0])
    if missing:
        return None
    flow, drop, rated, bypass = convert(settings, cylinder_keys.FILTER_KEYS).values()
    viscosity = settings[cylinder_keys.VISCOSITY_KEY.name].key.unit.to_si(
        settings[cylinder_keys.VISCOSITY_KEY.name].value
    )
    require_positive(cylinder_keys.VISCOSITY_KEY.name, viscosity, "")
    return Filter(
        resistance=drop / flow * viscosity / rated,
        bypass=math.inf if bypass is None else bypass,
    )


def _build_cushion(axis: Settings, end: str) -> Cushion | None:
    """Return the cushion of an end.

    Raises:
        ParameterError: half of its data are missing, or make no sense.
    """
    keys = cylinder_keys.CUSHION_KEYS[end]
    given = [key.name for key in keys if axis[key.name].value is not None]
    if not given:
        return None
    if len(given) == 1:
        other = next(key.name for key in keys if key.name not in given)
        raise ParameterError(f"a cushion has a length and an orifice: give {other} too", given[0])
    try:
        return Cushion(**convert(axis, keys))
    except ParameterError as error:
        raise ParameterError(str(error), f"{end}_{error.symbols[0]}_mm") from None


def _build_counterbalance(axis: Settings) -> CounterbalanceValve | None:
    """Return the counterbalance valves of an axis.

    Raises:
        ParameterError: one of their data is missing.
    """
    lines = axis["counterbalance"].value
    if lines is cylinder_keys.Lines.NONE:
        return None
    for key in (cylinder_keys.COUNTERBALANCE_KEYS[0], *cylinder_keys.COUNTERBALANCE_RATING):
        if axis[key.name].value is None:
            raise ParameterError(f"a valve needs its data: give {key.name} too", "counterbalance")
    flow, drop = convert(axis, cylinder_keys.COUNTERBALANCE_RATING).values()
    for key, value in zip(cylinder_keys.COUNTERBALANCE_RATING, (flow, drop), strict=True):
        require_positive(key.name, value, "")
    return CounterbalanceValve(
        in_line_a=lines in {cylinder_keys.Lines.A, cylinder_keys.Lines.BOTH},
        in_line_b=lines in {cylinder_keys.Lines.B, cylinder_keys.Lines.BOTH},
        conductance=flow / math.sqrt(drop),
        **convert(axis, cylinder_keys.COUNTERBALANCE_KEYS),
    )


def _build_pump(axis: Settings) -> VariablePump | None:
    """Return the variable pump of an axis; None for a fixed pump.

    Raises:
        ParameterError: the supply has no pump.
    """
    if (
        axis["pump_control"].value is not cylinder_keys.PumpControl.FIXED
        and axis["supply"].value is cylinder_keys.Supply.CONSTANT
    ):
        raise ParameterError(
            'a constant supply has no pump: give supply = "unit" too', "pump_control"
        )
    return variable_pump(axis)


def variable_pump(settings: Settings) -> VariablePump | None:
    """Return the variable pump of a supply; None for a fixed pump."""
    control = settings["pump_control"].value
    if control is cylinder_keys.PumpControl.FIXED:
        return None
    return VariablePump(
        senses_load=control is cylinder_keys.PumpControl.LOAD,
        **convert(settings, cylinder_keys.PUMP_KEYS),
    )


def _build_loads(axis: Settings) -> tuple[Load, ...]:
    loads: list[Load] = []
    if axis["load_n"].value:
        loads.append(ConstantLoad(**convert(axis, cylinder_keys.CONSTANT_LOAD_KEYS)))
    if axis["load_spring_n_mm"].value:
        loads.append(SpringLoad(**convert(axis, cylinder_keys.SPRING_KEYS)))
    if axis["load_mass_kg"].value:
        loads.append(MassOnSlope(**convert(axis, cylinder_keys.SLOPE_KEYS)))
    if series := axis[cylinder_keys.SERIES_KEY.name].value:
        times, forces = zip(*series, strict=True)
        loads.append(LoadSeries(times, forces))
    return tuple(loads)


def _check_solver(axis: CylinderConfig, step_us: int, problems: Problems) -> None:
    limit_us = largest_stable_step(axis.model, axis.parameters, axis.options, axis.solver) * 1e6
    if step_us <= limit_us:
        return
    rights = []
    if axis.solver is not Solver.LINEARLY_IMPLICIT_MIDPOINT:
        rights.append(f'solver = "{Solver.LINEARLY_IMPLICIT_MIDPOINT.value}"')
    if limit_us >= 1.0:
        rights.append(f"bench.step_us = {math.floor(limit_us)}")
    right = " or ".join(rights) or "a larger moving_mass_kg or a smaller bulk_modulus_mpa"
    wrong = f'"{axis.solver.value}" {shortcoming(axis.solver)} with these parameters'
    problems.add(
        problems.place(f"plant.{axis.name}", "solver"),
        f"{wrong} at step_us = {step_us}; give {right}",
    )


def _check_position(name: str, axis: Settings, problems: Problems) -> None:
    position, limit = axis["position_mm"].value, axis["stroke_mm"].value / 2.0
    if abs(position) > limit > 0.0:
        place = problems.place(f"plant.{name}", "position_mm")
        right = f"give {-limit:g} to {limit:g}, half of stroke_mm to each side"
        problems.add(place, f"{position:g} is beyond the stroke; {right}")


def explain_refusal(table: str, error: ParameterError, problems: Problems) -> None:
    """Note a plant's refusal under the key that the user wrote instead of the paper's symbol."""
    keys = list(
        dict.fromkeys(_KEYS_OF_SYMBOLS[each] for each in error.symbols if each in _KEYS_OF_SYMBOLS)
    )
    related = f" (see also {', '.join(keys[1:])})" if len(keys) > 1 else ""
    place = problems.place(table, keys[0] if keys else "")
    problems.add(place, str(error).replace(": ", "; ", 1) + related)
