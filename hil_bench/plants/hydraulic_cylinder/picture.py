"""The picture of a cylinder: bore, rod and stroke to scale, at the slope of its load."""

import math
from typing import Final

from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_bench.plants.hydraulic_cylinder.model.load import (
    ConstantLoad,
    Load,
    LoadSeries,
    MassOnSlope,
)
from hil_bench.plants.hydraulic_cylinder.quantities import P_S, POSITION, SPOOL_POSITION
from hil_bench.plants.plant import Circuit, Page

WIDTH: Final = 440.0
"""Of all pictures of hydraulic plants, and of the circuit below them."""

_ROOM = 34.0  # above and below the drawing, for texts and ports
_LYING, _STANDING = 92.0, 190.0  # greatest height of what is drawn
_PISTON, _LUG = 10.0, 16.0
_STEEP = math.radians(45.0)


def cylinder_page(axis: CylinderConfig) -> Page:
    """Return the picture of a cylinder with its circuit, and what is plotted first.

    Args:
        axis: its record.
    """
    p = axis.parameters
    plots = (POSITION.name, "spool_setpoint", SPOOL_POSITION.name, "P_A", "P_B", P_S)
    return Page(_Drawing(axis).svg(), plots, circuit_of(axis, p.A_A, p.A_B))


def circuit_of(axis: CylinderConfig, swept_a: float, swept_b: float) -> Circuit:
    """Return the hydraulics of an axis from what it is to the equations.

    Args:
        axis: what it is to the equations.
        swept_a: volume that port A takes for 1 SI unit of its speed.
        swept_b: volume that port B gives for it.
    """
    options, pressure = axis.options, axis.parameters.P_S
    lines = {"a": options.line_a, "b": options.line_b}
    valve, unit = options.counterbalance, options.supply
    guards = {
        "a": valve is not None and valve.in_line_a,
        "b": valve is not None and valve.in_line_b,
    }
    circuit = Circuit(
        pressure if unit is None else max(pressure, unit.relief_pressure),
        swept_a,
        swept_b,
        counterbalance="".join(side for side, has_one in guards.items() if has_one),
        hoses="".join(side for side, line in lines.items() if line is not None),
    )
    if unit is None:
        return circuit
    pump = "fixed"
    if unit.variable is not None:
        pump = "load-sensing" if unit.variable.senses_load else "constant-pressure"
    return circuit._replace(
        pump=pump,
        relief=unit.relief_pressure,
        accumulator=unit.accumulator_volume,
        has_filter=unit.filter is not None,
    )


class _Drawing:
    """A cylinder on paper: in its own frame the rod moves to the right.

    Args:
        axis: its record.
    """

    def __init__(self, axis: CylinderConfig) -> None:
        p = axis.parameters
        self._half, self._top = p.h, max(p.P_S, _relief(axis))
        self._loads = axis.options.loads
        self._slope = next(
            (each.slope for each in self._loads if isinstance(each, MassOnSlope)), 0.0
        )
        bore = 2.0 * math.sqrt(max(p.A_A, p.A_B) / math.pi)
        rod = 2.0 * math.sqrt(abs(p.A_A - p.A_B) / math.pi)
        cos, sin = abs(math.cos(self._slope)), abs(math.sin(self._slope))
        most = _STANDING if abs(self._slope) > _STEEP else _LYING
        fixed = _PISTON + _LUG + 34.0
        # Barrel and rod, each of a stroke, must fit at their slope; and the bore across.
        along = min((WIDTH - 20.0) / max(cos, 1e-6), most / max(sin, 1e-6)) - fixed
        across = most / max(cos, 0.5)
        self._scale = min(along / (4.0 * self._half), across / bore)
        self._stroke = 2.0 * self._half * self._scale
        self._bore = bore * self._scale
        self._rod = max(rod * self._scale, 3.0)
        self._is_double = rod < 1e-3 * bore
        self._length = 2.0 * self._stroke + fixed
        self._height = max(self._bore + 16.0, self._length * sin + self._bore * cos)

    def svg(self) -> str:
        """Return the picture."""
        height = self._height + 2.0 * _ROOM
        turn = -math.degrees(self._slope)
        shift = f"translate({WIDTH / 2:.1f} {height / 2:.1f}) rotate({turn:.2f})"
        centre = f"translate({-self._length / 2:.1f} 0)"
        body = f'<g transform="{shift} {centre}">{self._body()}</g>'
        ports = "".join(
            f'<circle class="port" data-port="{name}" cx="{x:.1f}" cy="{y:.1f}" r="2.5"/>'
            for name, x, y in self._ports(height)
        )
        return (
            f'<svg viewBox="0 0 {WIDTH:g} {height:.1f}">{body}{ports}'
            f'<text x="10" y="20" class="huge" data-text="{POSITION.name}"/>'
            f'<text x="{WIDTH - 10:g}" y="20" class="right" data-text="speed"/></svg>'
        )

    def _ports(self, height: float) -> tuple[tuple[str, float, float], ...]:
        """Return name, x and y of the ports of the barrel."""
        # Of a cylinder that stands, A is on the left, so that no line runs over the other port.
        steep = math.copysign(1.0, self._slope) if abs(self._slope) > _STEEP else 0.0
        ends = (
            ("A", _LUG + 4.0, -steep or 1.0),
            ("B", _LUG + self._stroke + _PISTON - 4.0, steep or 1.0),
        )
        cos, sin = math.cos(-self._slope), math.sin(-self._slope)
        found = []
        for name, along, side in ends:
            u, v = along - self._length / 2, side * (self._bore / 2 + 2.0)
            found.append((name, WIDTH / 2 + u * cos - v * sin, height / 2 + u * sin + v * cos))
        return tuple(found)

    def _body(self) -> str:
        left, bore, width = _LUG, self._bore, self._stroke + _PISTON
        top = -bore / 2
        place = f"{POSITION.name} {-self._half:.6g} {self._half:.6g} 0 {self._stroke:.2f}"
        colour = f"0 {self._top:.6g}"
        behind = ""
        if self._is_double:
            behind = _rect("steel", -self._stroke + left, -self._rod / 2, self._stroke, self._rod)
        moving = (
            f'<g data-x="{place}">{behind}'
            + _rect("steel", left, top, _PISTON, bore)
            + _rect("steel", left + _PISTON, -self._rod / 2, self._stroke + 8.0, self._rod)
            + self._load(left + _PISTON + self._stroke + 8.0)
            + "</g>"
        )
        return (
            f'<path class="ground" d="M 2 -12 v 24 M 2 0 h {_LUG - 2:g}"/>'
            f'<rect class="chamber" x="{left:.1f}" y="{top:.1f}" width="{width:.1f}" '
            f'height="{bore:.1f}" data-fill="P_B {colour}"/>'
            f'<rect class="chamber" x="{left:.1f}" y="{top:.1f}" width="0" height="{bore:.1f}" '
            f'data-fill="P_A {colour}" data-width="{place}"/>'
            f'{moving}<rect class="barrel" x="{left:.1f}" y="{top:.1f}" width="{width:.1f}" '
            f'height="{bore:.1f}"/>{self._cushions(left, width, bore)}'
        )

    def _cushions(self, left: float, width: float, bore: float) -> str:
        """Return the ends of the stroke as ticks beside the barrel."""
        y = bore / 2 + 6.0
        ends = (left + _PISTON / 2, left + width / 2, left + width - _PISTON / 2)
        return "".join(f'<path class="scale" d="M {x:.1f} {-y:.1f} v -6"/>' for x in ends)

    def _load(self, x: float) -> str:
        """Return the mass at the rod's end, with an arrow in the direction of its load."""
        mass = next((each for each in self._loads if isinstance(each, MassOnSlope)), None)
        drawn = _rect("mass", x, -14.0, 22.0, 28.0)
        if mass is not None and abs(mass.slope) > 1e-3:
            turn = math.degrees(self._slope)
            drawn += (
                f'<g transform="translate({x + 11.0:.1f} 0) rotate({turn:.2f})">'
                '<path class="force" d="M 0 -6 V 22 M -4 15 L 0 22 L 4 15"/></g>'
            )
        push = sum(_constant(each) for each in self._loads)
        if push or any(isinstance(each, LoadSeries) for each in self._loads):
            to = -1.0 if push >= 0.0 else 1.0  # a positive load pushes the rod in
            tip, tail = x + 11.0 + 9.0 * to, x + 11.0 - 9.0 * to
            head = f"M {tip - 5 * to:.1f} -4 L {tip:.1f} 0 L {tip - 5 * to:.1f} 4"
            drawn += f'<path class="force" d="M {tail:.1f} 0 H {tip:.1f} {head}"/>'
        return drawn


def _constant(load: Load) -> float:
    return load.load_force if isinstance(load, ConstantLoad) else 0.0


def _relief(axis: CylinderConfig) -> float:
    unit = axis.options.supply
    return 0.0 if unit is None else unit.relief_pressure


def _rect(name: str, x: float, y: float, width: float, height: float) -> str:
    return (
        f'<rect class="{name}" x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}"/>'
    )
