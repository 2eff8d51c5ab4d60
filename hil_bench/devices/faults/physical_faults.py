"""The faults of valve, cylinder and supply: what wears, breaks, leaks and falls off.

Each may grow: from nothing, when it begins, to all of it after a time.
"""

from functools import partial
from typing import NamedTuple, Unpack

from hil_bench.devices.faults.checks import bounded, choose, find, missing_defect, to_ns
from hil_bench.devices.faults.effects import Act, DefectEffect, Growth, SpoolEffect
from hil_bench.devices.faults.fault import Fault
from hil_bench.devices.faults.kinds import LEAKS, FaultKind, LeakPath
from hil_bench.devices.faults.points import FaultPoints
from hil_bench.devices.faults.schedule import FaultSchedule, When
from hil_bench.devices.faults.spool_stages import Bound, Weak
from hil_bench.errors import ConfigError


class _Wear(NamedTuple):
    """A defect that a fault makes.

    Attributes:
        name: of the defect.
        amount: what it comes to.
        growth: how long that takes [s].
    """

    name: str
    amount: float
    growth: float


class PhysicalFaults(FaultSchedule):
    """The faults of the plants of one bench.

    Args:
        points: what may have faults.
        tick_ns: time between two ticks [ns].
        holds: called before each tick of the plants.
    """

    def __init__(self, points: FaultPoints, tick_ns: int, holds: list[Act]) -> None:
        super().__init__()
        self._holds = holds
        self._points = points
        self._tick = tick_ns * 1e-9

    def leak(
        self,
        axis: str,
        conductance: float,
        path: LeakPath | str = LeakPath.INTERNAL,
        *,
        growth: float = 0.0,
        **when: Unpack[When],
    ) -> Fault:
        """Let oil leak: past the piston, or from chamber "a" or "b" to the tank.

        Args:
            axis: whose plant leaks.
            conductance: flow for each pressure [m³/(s Pa)].
            path: between what.
            growth: how long the leak takes to grow to that [s].
            when: begin and duration.
        """
        name = LEAKS[choose("path", LeakPath, path)]
        return self._wear(FaultKind.LEAK, axis, _Wear(name, conductance, growth), when)

    def aerate(
        self, axis: str, share: float, *, growth: float = 0.0, **when: Unpack[When]
    ) -> Fault:
        """Let air into the oil: a share of the volume at atmospheric pressure."""
        return self._wear(FaultKind.AERATE, axis, _Wear("entrained_air", share, growth), when)

    def wear_spool(
        self, axis: str, opening: float, *, growth: float = 0.0, **when: Unpack[When]
    ) -> Fault:
        """Round the edges of the spool: the opening that leaks in the centre grows by this [m]."""
        return self._wear(FaultKind.WEAR_SPOOL, axis, _Wear("null_opening", opening, growth), when)

    def jam(self, axis: str, force: float, *, growth: float = 0.0, **when: Unpack[When]) -> Fault:
        """Add dry friction [N] to piston or load."""
        return self._wear(FaultKind.JAM, axis, _Wear("dry_friction", force, growth), when)

    def drop_load(
        self, axis: str, share: float = 1.0, *, growth: float = 0.0, **when: Unpack[When]
    ) -> Fault:
        """Remove a share of the loads, with their mass, from the rod."""
        return self._wear(FaultKind.DROP_LOAD, axis, _Wear("load_loss", share, growth), when)

    def wear_pump(
        self, axis: str, share: float = 1.0, *, growth: float = 0.0, **when: Unpack[When]
    ) -> Fault:
        """Let the pump of a supply unit lose a share of its flow."""
        return self._wear(FaultKind.WEAR_PUMP, axis, _Wear("pump_loss", share, growth), when)

    def sag_relief(
        self, axis: str, pressure: float, *, growth: float = 0.0, **when: Unpack[When]
    ) -> Fault:
        """Let the relief valve of a supply unit open too early, by a pressure [Pa]."""
        return self._wear(FaultKind.SAG_RELIEF, axis, _Wear("relief_sag", pressure, growth), when)

    def lose_gas(
        self, axis: str, share: float = 1.0, *, growth: float = 0.0, **when: Unpack[When]
    ) -> Fault:
        """Let the accumulator of a supply unit lose a share of its gas."""
        return self._wear(FaultKind.LOSE_GAS, axis, _Wear("gas_loss", share, growth), when)

    def clog_filter(
        self, axis: str, share: float = 1.0, *, growth: float = 0.0, **when: Unpack[When]
    ) -> Fault:
        """Let dirt block a share of the element of a supply unit's filter."""
        wear = _Wear("filter_clogging", share, growth)
        return self._wear(FaultKind.CLOG_FILTER, axis, wear, when)

    def bind(self, valve: str, band: float, *, growth: float = 0.0, **when: Unpack[When]) -> Fault:
        """Let the spool stick until its set-point differs by a share of the full opening."""
        point = find("valve", valve, self._points.valves)
        bounded("band", band, low=0.0, high=1.0)
        ticks = self._ticks(growth)
        effect = SpoolEffect(
            point, lambda position: Bound(Growth(band * point.full, ticks), position).follow
        )
        return self.add(FaultKind.BIND, valve, effect, when)

    def weaken(
        self, valve: str, travel: float, *, growth: float = 0.0, **when: Unpack[When]
    ) -> Fault:
        """Let the solenoids move the spool by a share of the full opening only; 0 by none."""
        point = find("valve", valve, self._points.valves)
        bounded("travel", travel, low=0.0, high=1.0)
        ticks = self._ticks(growth)
        effect = SpoolEffect(
            point, lambda _position: Weak(Growth(1.0 - travel, ticks), point.full).follow
        )
        return self.add(FaultKind.WEAKEN, valve, effect, when)

    def _wear(self, kind: FaultKind, axis: str, wear: "_Wear", when: When) -> Fault:
        point = find("axis", axis, self._points.plants)
        if wear.name not in point.known:
            raise ConfigError(f"faults: {axis} {missing_defect(wear.name)}")
        bounded(kind.value, wear.amount, low=0.0, high=point.known[wear.name].high)
        grow = partial(Growth, wear.amount, self._ticks(wear.growth))
        return self.add(kind, axis, DefectEffect(point, wear.name, grow, self._holds), when)

    def _ticks(self, growth: float) -> int:
        return round(to_ns("growth", growth) * 1e-9 / self._tick)
