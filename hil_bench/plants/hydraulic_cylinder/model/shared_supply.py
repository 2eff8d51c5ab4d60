"""One supply unit behind the valves of several plants.

Pump, relief valve, line and accumulator are those of `model.supply`, with the oil that all plants
draw:

    C_S dP_S/dt = Q_P - G max(P_S - P_R, 0) - sum of Q_k

From exchange to exchange each plant k has a share w_k of the unit for itself, and its kernel steps
it with valve and cylinder, linearly implicitly: a share of the line, of the gas, of the relief
valve, and of the pump the flow

    q_k = Q_k' + w_k (Q_P - sum of Q_j'),   sum of q_k = Q_P

with the flow Q_k' that it drew from exchange to exchange before. In the exchange the oil of all
shares becomes that of one pressure. Oil is neither made nor lost, whatever the plants draw: what is
lost is the energy of the pressures that meet, and that is none in steady motion, where q_k is what
plant k draws. Every share is passive and so is the exchange, so no consumer, however stiff, makes
them unstable; a flow that changes is off by the square of the time between two exchanges.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from inspect import unwrap
from typing import Protocol

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model.constants import (
    filter_constants,
    pump_constants,
    supply_constants,
)
from hil_bench.plants.hydraulic_cylinder.model.defects import Defects, wear_supply
from hil_bench.plants.hydraulic_cylinder.model.extensions import (
    ATMOSPHERE,
    MeteringLands,
    SupplyUnit,
)
from hil_bench.plants.hydraulic_cylinder.model.full_order import FullOrderPlant
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.supply import (
    AS_GIVEN,
    FilterConstants,
    OilNow,
    SupplyConstants,
    behind_filter,
    relief_flow,
    supply_compliance,
    swivel,
)

FINE = 0.1
"""Change of a share's pressure between two exchanges that is fine, as a share of the relief
pressure, where a plant begins to draw all that its open valve passes ..."""
COARSE = 0.5
"""... and the change that is refused."""

# From Python, a call of a compiled kernel with its tuples takes ten times as long as these.
_supply_compliance: Callable[..., float] = unwrap(supply_compliance)
_relief_flow: Callable[..., float] = unwrap(relief_flow)
_swivel: Callable[..., float] = unwrap(swivel)
_behind_filter: Callable[..., tuple[SupplyConstants, float]] = unwrap(behind_filter)

_ROUNDS = 60
_CLOSE = 10.0  # [Pa], a step of Newton's method after which it is off by 1e-5 Pa


class Mover(Protocol):
    """A plant, or a part of one, that can be moved on."""

    def drive(self, command: float, steps: int) -> Sequence[float]:
        """Move the plant on by `steps` steps under a constant command [SI]."""


class SharedSupply:
    """A supply unit and the plants that draw from it.

    Args:
        unit: the whole unit.
        modulus: bulk modulus of the oil in its line [Pa].
        pressure: P_S at the start [Pa].
        tank: P_T [Pa].
        plants: each with the share of the unit that `share_unit` gives, and what moves it.
        shares: w of each plant, with the sum 1.
        exchange: steps from exchange to exchange.

    Attributes:
        pressure: P_S [Pa]; what is written is where the unit goes on from.
        flow: that of the pump [m³/s].
        drop: over the filter [Pa].
        work: what the pump has done on the oil so far [J].
        drawn: what each plant drew in the last `drive`, on average [m³/s].
    """

    def __init__(
        self,
        unit: SupplyUnit,
        modulus: float,
        pressure: float,
        tank: float,
        plants: Sequence[tuple[FullOrderPlant, Mover]],
        shares: Sequence[float],
        exchange: int,
    ) -> None:
        self.pressure, self._tank = pressure, tank
        self.drop = 0.0
        self._oil, self._pump_share = AS_GIVEN, 1.0
        self._unit, self._modulus = unit, modulus
        self._plants, self._shares = tuple(plants), tuple(shares)
        self._dt, self._exchange_steps = plants[0][0].dt, exchange
        self._draws = [0.0] * len(plants)
        self.work = 0.0
        self.drawn = [0.0] * len(plants)
        self._senses = unit.variable is not None and unit.variable.senses_load
        self.flow = 0.0 if unit.variable is not None else unit.pump_flow
        self.wear(Defects())

    def wear(self, defects: Defects) -> None:
        """Let pump, relief valve and accumulator be worn; the plants' shares are not touched."""
        self._worn, oil = defects, self._oil
        worn = wear_supply(self._unit, defects)
        modulus = self._modulus if oil is AS_GIVEN else oil.modulus(self._modulus)
        line, flow, opens_at, *rest = supply_constants(worn, modulus)
        opens_at = max(opens_at - defects.relief_sag, 0.0)
        flow *= self._pump_share
        self._constants: SupplyConstants = (line, flow, opens_at, *rest)  # type: ignore[assignment]
        self._pump = pump_constants(worn)
        resistance, bypass = filter_constants(worn)
        self._element: FilterConstants = (resistance * oil.viscosity, bypass)
        self._leakage = self._pump[2] / oil.dynamic
        self._lends = bool(resistance) or oil is not AS_GIVEN

    def warm(self, oil: OilNow, pump_share: float) -> None:
        """Go on with warmer or colder oil.

        Args:
            oil: as it is now.
            pump_share: what the pump gives, over its flow as configured.
        """
        self._oil, self._pump_share = oil, pump_share
        self.wear(self._worn)

    def resume(self, draws: Sequence[float]) -> None:
        """Go on from what each plant drew [m³/s]; a pump that swivels gives as much."""
        self._draws = list(draws)
        self.drawn = list(draws)
        if self._unit.variable is not None:
            self.flow = min(max(math.fsum(draws), 0.0), self._constants[1])

    @property
    def sensed_pressure(self) -> float:
        """The highest pressure of a load [Pa]; that of the tank where no spool feeds a port."""
        return max(self._tank, *(plant.sensed_pressure for plant, _ in self._plants))

    def drive(self, commands: Sequence[float], steps: int) -> None:
        """Move all plants and the supply on by `steps` steps under constant commands [SI]."""
        sums = [0.0] * len(self._draws)
        left = steps
        while left > 0:
            count = min(self._exchange_steps, left)
            self._exchange(commands, count)
            for number, draw in enumerate(self._draws):
                sums[number] += draw * count
            left -= count
        if steps:
            self.drawn = [total / steps for total in sums]

    def _exchange(self, commands: Sequence[float], steps: int) -> None:
        """Move the plants on with their shares, then let the shares meet."""
        time, P_S, constants = steps * self._dt, self.pressure, self._constants
        sensed = self.sensed_pressure if self._senses else 0.0
        at_pump = P_S + self.drop
        given = constants[1]
        if self._pump[0]:
            given = _swivel(self.flow, at_pump, sensed, 0.5 * time, self._pump, constants)
        pumped = time * given
        if self._leakage:
            capacity = _supply_compliance(P_S, constants) + time * self._leakage
            leaked = self._leakage * (P_S - self._tank)
            given -= leaked * (1.0 - time * self._leakage / capacity)
        spare = given - sum(self._draws)
        flows = [
            draw + share * spare for draw, share in zip(self._draws, self._shares, strict=True)
        ]
        unit, has_filter = constants, bool(self._element[0])
        if has_filter:
            unit, _ = _behind_filter(P_S, given, constants, self._element)
        pressures = []
        if self._lends:
            for (plant, _), share in zip(self._plants, self._shares, strict=True):
                plant.lend(share * unit[0], unit[2], share * unit[3])
        for (plant, mover), command, flow in zip(self._plants, commands, flows, strict=True):
            plant.feed(P_S, flow)
            mover.drive(command, steps)
            pressures.append(plant.supply_pressure)

        met = meet(pressures, self._shares, constants)
        held = stored_oil(P_S, constants)
        for number, (share, pressure) in enumerate(zip(self._shares, pressures, strict=True)):
            relieved = _relief_flow(0.5 * (P_S + pressure), unit)
            gained = (stored_oil(pressure, constants) - held) / time
            self._draws[number] = flows[number] - share * (relieved + gained)
        sensed = self.sensed_pressure if self._senses else 0.0
        if has_filter:
            _, self.drop = _behind_filter(0.5 * (P_S + met), given, constants, self._element)
        at_pump = 0.5 * (P_S + met) + self.drop
        if self._pump[0]:
            self.flow = _swivel(self.flow, at_pump, sensed, time, self._pump, constants)
        else:
            self.flow = given
        self.work += at_pump * pumped
        self.pressure = met

    @property
    def energy(self) -> float:
        """The energy of line and accumulator beyond that at 0 Pa and the precharge [J]."""
        line, _, _, _, volume, precharge, n = self._constants
        held, p = 0.5 * line * self.pressure**2, self.pressure + ATMOSPHERE
        if not volume or p <= precharge:
            return held
        gas = volume * math.exp(math.log(precharge / p) / n)
        pushed = ATMOSPHERE * (volume - gas)
        if n == 1.0:
            return held + precharge * volume * math.log(volume / gas) - pushed
        return held + (p * gas - precharge * volume) / (n - 1.0) - pushed


def stored_oil(P_S: float, supply: SupplyConstants) -> float:
    """Return the oil that line and accumulator hold beyond that at 0 Pa [m³]."""
    line, _, _, _, volume, precharge, n = supply
    p = P_S + ATMOSPHERE
    if not volume or p <= precharge:
        return line * P_S
    return line * P_S + volume * (1.0 - math.exp(math.log(precharge / p) / n))


def meet(pressures: Sequence[float], shares: Sequence[float], supply: SupplyConstants) -> float:
    """Return the one pressure [Pa] at which shares of a unit hold the oil that they have.

    Args:
        pressures: of the shares [Pa].
        shares: what part of the unit each is.
        supply: constants of the whole unit.
    """
    low, high = min(pressures), max(pressures)
    if len(pressures) == 1 or low == high:
        return pressures[0]
    parts = tuple(zip(shares, pressures, strict=True))
    weights = [share * _supply_compliance(P, supply) for share, P in parts]
    met = sum(w * P for w, P in zip(weights, pressures, strict=True)) / sum(weights)
    held = sum(share * stored_oil(P, supply) for share, P in parts)
    for _ in range(_ROUNDS if supply[4] else 0):  # Newton's method, kept between the pressures
        excess = stored_oil(met, supply) - held
        low, high = (low, met) if excess > 0.0 else (met, high)
        guess = met - excess / _supply_compliance(met, supply)
        guess = guess if low <= guess <= high else 0.5 * (low + high)
        if abs(guess - met) < _CLOSE:
            return guess
        met = guess
    return met


def share_unit(unit: SupplyUnit, share: float, modulus: float, E: float) -> SupplyUnit:
    """Return the share of a unit that a plant has for itself between two exchanges.

    Args:
        unit: the whole.
        share: which part of it.
        modulus: bulk modulus of the oil in its line [Pa].
        E: that of the plant, whose constants the line's compliance is made with [Pa].
    """
    return replace(
        unit,
        pump_flow=unit.pump_flow * share,
        relief_gradient=unit.relief_gradient * share,
        line_volume=unit.line_volume * (share * (E / modulus)),
        accumulator_volume=unit.accumulator_volume * share,
        variable=None,
        filter=None,
    )


def full_draw(parameters: PlantParameters, options: PlantOptions, pressure: float) -> float:
    """Return the flow through a plant's wide open valve without a load [m³/s].

    Args:
        parameters: of the plant.
        options: of the plant.
        pressure: of the supply [Pa]; half of it drops over the edge that feeds.
    """
    margin = math.inf if options.compensator_margin is None else options.compensator_margin
    lands = MeteringLands() if options.lands is None else options.lands
    alpha = max(parameters.alpha, options.alpha_negative or 0.0)
    drop = min(0.5 * max(pressure - parameters.P_T, 0.0), margin)
    return parameters.K * alpha * max(lands.gain_pa, lands.gain_pb) * math.sqrt(drop)


def exchange_steps(
    unit: SupplyUnit, modulus: float, draws: Sequence[float], dt: float, steps: int
) -> int:
    """Return the steps from exchange to exchange, the most that is fine and divides a tick's.

    A plant whose valve opens wide draws from its share until the next exchange. The shares are in
    the proportion of those draws, so that changes the pressure of each by as much.

    Args:
        unit: the whole.
        modulus: bulk modulus of the oil in its line [Pa].
        draws: what the wide open valve of each plant draws [m³/s].
        dt: step [s].
        steps: of a tick.

    Raises:
        ParameterError: one step changes it by more than `COARSE`.
    """
    constants, P_R = supply_constants(unit, modulus), unit.relief_pressure
    rate = math.fsum(draws) / _supply_compliance(P_R, constants)  # [Pa/s]
    if rate * dt > COARSE * P_R:
        most = dt * math.fsum(draws) / (COARSE * P_R) * modulus
        raise ParameterError(
            f"line_volume = {unit.line_volume * 1e6:.3g} cm³: valves that open change P_S by "
            f"{rate * dt * 1e-5:.3g} bar in a step of {dt * 1e6:.3g} us; at least "
            f"{most * 1e6:.3g} cm³, an accumulator or a shorter step resolves it",
            "line_volume",
        )
    most = FINE * P_R / (rate * dt) if rate > 0.0 else math.inf
    return max(
        count for count in range(1, steps + 1) if steps % count == 0 and count <= max(most, 1.0)
    )
