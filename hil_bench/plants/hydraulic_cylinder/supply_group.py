"""One supply for several axes: its record, and how it and its axes are built and moved on."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, cast, runtime_checkable

from hil_bench.plants.hydraulic_cylinder.configuration import (
    CylinderConfig,
    held_supply,
    supply_defects,
)
from hil_bench.plants.hydraulic_cylinder.cylinder import FullOrderCylinder
from hil_bench.plants.hydraulic_cylinder.data_sheet.oil import TEMPERATURE_C
from hil_bench.plants.hydraulic_cylinder.model.constants import supply_constants
from hil_bench.plants.hydraulic_cylinder.model.defects import Defects
from hil_bench.plants.hydraulic_cylinder.model.extensions import SupplyUnit
from hil_bench.plants.hydraulic_cylinder.model.shared_supply import (
    SharedSupply,
    exchange_steps,
    full_draw,
    share_unit,
    stored_oil,
)
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import steady_motion
from hil_bench.plants.hydraulic_cylinder.quantities import P_S, Q_S, T_OIL
from hil_bench.plants.hydraulic_cylinder.summary import filter_facts
from hil_bench.plants.hydraulic_cylinder.tank import Tank, TankConfig
from hil_bench.plants.plant import SUPPLY, AxisConfig, Fact, Influence, PlantKind
from hil_bench.units import BAR, LITRE, LITRE_PER_MINUTE

_ANY_FLOW = 1e3  # [m³/s]
_HOT = 80.0  # [°C], beyond which mineral oil ages fast
_NOTICED = 0.1  # [K] after which the plants get other constants


@runtime_checkable
class Fed(Protocol):
    """The record of an axis that a valve feeds.

    Attributes:
        name: of the axis.
        kind: of its plant.
        cylinder: what it is to the equations.
    """

    @property
    def name(self) -> str: ...  # noqa: D102 - above
    @property
    def kind(self) -> PlantKind[Any]: ...  # noqa: D102 - above
    @property
    def cylinder(self) -> CylinderConfig: ...  # noqa: D102 - above

    def fed_by(self, unit: SupplyUnit) -> AxisConfig:
        """Return the axis with another supply unit."""


class Hydraulic(Protocol):
    """The plant of an axis that can share a supply.

    Attributes:
        model: the cylinder that it is to the equations.
    """

    @property
    def model(self) -> FullOrderCylinder: ...  # noqa: D102 - above

    @property
    def output(self) -> Sequence[float]:
        """The present outputs in SI."""

    def drive(self, command: float, steps: int) -> Sequence[float]:
        """Move the plant on."""

    def go_to(self, values: Mapping[str, float]) -> None:
        """Go on from other values."""

    def influence(self, name: str, value: float | None) -> None:
        """Set what acts on it from outside."""


@dataclass(frozen=True, slots=True)
class SupplyConfig:
    """A supply unit that several axes share.

    Attributes:
        name: as in ``[supply.NAME]``.
        unit: pump, relief valve, line and accumulator.
        modulus: bulk modulus of the oil in its line [Pa].
        pressure: P_S at the start [Pa].
        tank_pressure: P_T [Pa].
        axes: names of the axes that it feeds, in the order of the file.
        exchange: steps of the solver from exchange to exchange between the axes.
        temperature: of the oil at the start [°C].
        tank: of oil whose temperature changes; None for oil that stays as it is.
    """

    name: str
    unit: SupplyUnit
    modulus: float
    pressure: float
    tank_pressure: float
    axes: tuple[str, ...]
    exchange: int = 1
    temperature: float = TEMPERATURE_C
    tank: TankConfig | None = None

    def exchanged(self, steps: int) -> "SupplyConfig":
        """Return the record with another time from exchange to exchange."""
        return replace(self, exchange=steps)

    @property
    def held(self) -> Influence:
        """The influence of a pressure that is held."""
        return held_supply(self.tank_pressure, self.pressure, self.unit)

    @property
    def defects(self) -> tuple[Influence, ...]:
        """The defects of the supply."""
        return supply_defects(self.unit)


def find_exchange(supply: SupplyConfig, axes: Sequence[Fed], dt: float, steps: int) -> int:
    """Return the steps from exchange to exchange; `ParameterError` where one step is too long.

    Args:
        supply: it.
        axes: those that it feeds.
        dt: step [s].
        steps: of a tick.
    """
    return exchange_steps(supply.unit, supply.modulus, _draws(supply, axes), dt, steps)


def _draws(supply: SupplyConfig, axes: Sequence[Fed]) -> list[float]:
    cylinders = (axis.cylinder for axis in axes)
    pressure = supply.unit.relief_pressure
    return [full_draw(each.parameters, each.options, pressure) for each in cylinders]


def summarise_supply(supply: SupplyConfig, axes: Sequence[Fed], dt: float) -> Iterator[Fact]:
    """Yield what an engineer checks first of a shared supply.

    Args:
        supply: it.
        axes: those that it feeds.
        dt: step [s].
    """
    unit = supply.unit
    wanted = math.fsum(_wanted(unit, axis.cylinder) for axis in axes)
    lacking = wanted - unit.pump_flow
    yield Fact("flow of the pump", LITRE_PER_MINUTE.from_si(unit.pump_flow), "l/min")
    note = "more than the pump gives" if lacking > 0.0 else "the pump gives it"
    yield Fact("flow of all axes at top speed", LITRE_PER_MINUTE.from_si(wanted), "l/min", note)
    yield Fact("pressure at rest", BAR.from_si(_pressure_at_rest(supply)), "bar", "no axis draws")
    if unit.accumulator_volume:
        constants = supply_constants(unit, supply.modulus)
        oil = stored_oil(unit.relief_pressure, constants)
        oil -= stored_oil(unit.precharge_pressure, constants)
        note = "from the relief valve's pressure to the precharge"
        yield Fact("oil in the accumulator", LITRE.from_si(oil), "l", note)
        if lacking > 0.0:
            note = "all axes at top speed"
            yield Fact("  which lasts", oil / lacking, "s", note)
    yield from filter_facts(unit)
    yield from _heat_facts(supply)
    share = " and ".join(axis.name for axis in axes)
    yield Fact("exchange of the shares", supply.exchange * dt * 1e6, "us", f"between {share}")


def _wanted(unit: SupplyUnit, axis: CylinderConfig) -> float:
    """Return the flow of an axis at its top speed from an unlimited pump [m³/s]."""
    options = replace(axis.options, supply=replace(unit, pump_flow=_ANY_FLOW))
    return max(
        steady_motion(axis.parameters, options, extends=extends).supply_flow
        for extends in (True, False)
    )


def _heat_facts(supply: SupplyConfig) -> Iterator[Fact]:
    tank, pressure = supply.tank, _pressure_at_rest(supply)
    if tank is None:
        return
    pump = supply.unit.variable
    flow = supply.unit.pump_flow if pump is None else pump.leakage * pressure
    heat = pressure * flow / tank.efficiency
    yield Fact("heat at rest", heat * 1e-3, "kW", "the pump's power, while no axis draws")
    rate = heat / tank.capacity * 60.0
    yield Fact("  by which the oil warms", rate, "K/min", "without cooling")
    steady = tank.steady(heat)
    if math.isfinite(steady):
        note = "hotter than oil stands" if steady > _HOT else "after hours, with its cooling"
        yield Fact("  and comes to", steady, "°C", note)


def _pressure_at_rest(supply: SupplyConfig) -> float:
    unit = supply.unit
    if unit.variable is None:
        return unit.relief_pressure + unit.pump_flow / unit.relief_gradient
    if unit.variable.senses_load:
        return min(supply.tank_pressure + unit.variable.margin, unit.relief_pressure)
    return unit.relief_pressure


class Consumer:
    """The plant of an axis that shares its supply.

    Args:
        plant: of the axis, with its share of the supply.
        group: which it belongs to.
        number: its place there.
    """

    def __init__(self, plant: Hydraulic, group: "SupplyGroup", number: int) -> None:
        self.plant, self._group, self._number = plant, group, number

    @property
    def output(self) -> Sequence[float]:
        """The plant's output, P_S [Pa], flow drawn [m³/s], T_oil [°C], drop over a filter [Pa]."""
        group, supply = self._group, self._group.supply
        drawn = supply.drawn[self._number]
        seen = (*self.plant.output, supply.pressure, drawn, group.temperature)
        return (*seen, supply.drop) if group.has_filter else seen

    def drive(self, command: float, steps: int) -> Sequence[float]:
        """Move the plant on by itself, with its share of the supply alone."""
        self.plant.drive(command, steps)
        return self.output

    def go_to(self, values: Mapping[str, float]) -> None:
        """Go on from other values."""
        self.plant.go_to(values)
        if P_S in values:
            self._group.supply.pressure = values[P_S]

    def influence(self, name: str, value: float | None) -> None:
        """Set what acts on the plant; its supply pressure is that of all."""
        if name == SUPPLY:
            self._group.influence(name, value)
        else:
            self.plant.influence(name, value)


class SupplyGroup:
    """A shared supply and the plants of its axes, which move on together.

    Args:
        config: of the supply.
        axes: those that it feeds.
        dt: step [s].
        starts: states of the axes to begin with, by the names of their quantities; None for rest.

    Attributes:
        name: of the supply.
        axes: names of the axes.
        supply: the unit.
        plants: of the axes, in their order.
        tank: the temperature of the oil; None where it stays as it is.
        has_filter: whether the unit has one.
        held: the influence of a pressure that is held.
        defects: what may be worn or broken at it.
    """

    def __init__(
        self,
        config: SupplyConfig,
        axes: Sequence[Fed],
        dt: float,
        starts: Sequence[Mapping[str, float]] | None = None,
    ) -> None:
        self.name, self.axes = config.name, config.axes
        self.held, self.defects = config.held, config.defects
        draws = _draws(config, axes)
        shares = [draw / math.fsum(draws) for draw in draws]
        self._movers = [
            _build(config, axis, share, dt, start)
            for axis, share, start in zip(axes, shares, starts or [{}] * len(axes), strict=True)
        ]
        self.supply = SharedSupply(
            config.unit,
            config.modulus,
            config.pressure,
            config.tank_pressure,
            [(each.model, each) for each in self._movers],
            shares,
            config.exchange,
        )
        self.plants = tuple(Consumer(each, self, i) for i, each in enumerate(self._movers))
        self.has_filter = config.unit.filter is not None
        self._defects = Defects()
        self.tank: Tank | None = None
        self._temperature = config.temperature
        self._efficiency = self._packed_at = 1.0
        if config.tank is not None:
            self.tank = Tank(config.tank)
            self._pack(self.tank)
        if starts:
            self._resume(starts)

    def _resume(self, starts: Sequence[Mapping[str, float]]) -> None:
        """Go on from the pressure, the flows and the temperature that the axes had."""
        first = starts[0]
        self.supply.pressure = first.get(P_S, self.supply.pressure)
        self.supply.resume([start.get(Q_S, 0.0) for start in starts])
        if self.tank is not None and T_OIL in first:
            self.tank.temperature = first[T_OIL]
            self._pack(self.tank)
        self._temperature = first.get(T_OIL, self._temperature)

    @property
    def temperature(self) -> float:
        """Of the oil [°C]."""
        return self._temperature if self.tank is None else self.tank.temperature

    def drive(self, commands: Sequence[float], steps: int) -> Sequence[Sequence[float]]:
        """Move all plants on by `steps` steps under constant commands [SI]."""
        if self.tank is None:
            self.supply.drive(commands, steps)
        else:
            self._warm(self.tank, commands, steps)
        return [plant.output for plant in self.plants]

    def _warm(self, tank: Tank, commands: Sequence[float], steps: int) -> None:
        """Move all plants on, and the oil's temperature with what becomes heat."""
        supply, models = self.supply, [each.model for each in self._movers]
        earlier, held, pumped = [model.seen for model in models], supply.energy, supply.work
        supply.drive(commands, steps)
        passed_on = math.fsum(map(passed_on_by, models, earlier)) + supply.energy - held
        heat = (supply.work - pumped) / self._efficiency - passed_on
        tank.warm(heat, steps * models[0].dt)
        if abs(tank.temperature - self._packed_at) >= _NOTICED:
            self._pack(tank)

    def _pack(self, tank: Tank) -> None:
        """Let all plants have the oil that the tank has now."""
        self._packed_at = tank.temperature
        oil = tank.oil_now()
        pump_share, self._efficiency = tank.config.pump_at(oil.dynamic)
        self.supply.warm(oil, pump_share)
        for each in self._movers:
            each.model.warm(oil)

    def influence(self, name: str, value: float | None) -> None:
        """Set P_S [Pa] or a defect of the unit; let go, it fills up."""
        if name != SUPPLY:
            amount = 0.0 if value is None else value
            self._defects = replace(self._defects, **{name: amount})
            self.supply.wear(self._defects)
            for each in self._movers:
                each.influence(name, amount)
        elif value is not None:
            self.supply.pressure = value


def passed_on_by(model: FullOrderCylinder, before: Sequence[float]) -> float:
    """Return the plant's work on its load and the energy stored in mass and oil since then [J]."""
    p, options, modulus = model.parameters, model.options, model.modulus
    x_0, v_0, a_0, b_0, *_ = before
    x_1, v_1, a_1, b_1, *_ = model.seen
    x = 0.5 * (x_0 + x_1)
    load = model.load + (options.load_at(x, model.time) if options.loads else 0.0)
    within = min(max(x, -p.h), p.h)
    stored = (p.m + options.load_mass) * (v_1 * v_1 - v_0 * v_0)
    stored += (p.V_A0 + p.A_A * within) / modulus * (a_1 * a_1 - a_0 * a_0)
    stored += (p.V_B0 - p.A_B * within) / modulus * (b_1 * b_1 - b_0 * b_0)
    return load * (x_1 - x_0) + 0.5 * stored


def _build(
    config: SupplyConfig, axis: Fed, share: float, dt: float, start: Mapping[str, float]
) -> Hydraulic:
    unit = share_unit(config.unit, share, config.modulus, axis.cylinder.parameters.E)
    return cast("Hydraulic", axis.kind.build(axis.fed_by(unit), dt, start or None))
