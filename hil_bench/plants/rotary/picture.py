"""The picture of a hydraulic motor: its symbol of ISO 1219, and the drum that it turns."""

import math

from hil_bench.plants.hydraulic_cylinder.picture import WIDTH, circuit_of
from hil_bench.plants.hydraulic_cylinder.quantities import P_S, SPOOL_POSITION
from hil_bench.plants.page import Page
from hil_bench.plants.rotary.configuration import RotaryConfig
from hil_bench.plants.rotary.quantities import ANGLE

_SPOKES = "".join(
    f'<path class="spoke" d="M 0 0 L {44 * math.cos(turn):.1f} {44 * math.sin(turn):.1f}"/>'
    for turn in (math.radians(120 * number) for number in range(3))
)
_RADIUS = 34.0


def motor_page(axis: RotaryConfig) -> Page:
    """Return the picture of a motor with its circuit, and what is plotted first.

    Args:
        axis: its record.
    """
    top = circuit_of(axis.cylinder, axis.displacement, axis.displacement)
    plots = ("speed", "spool_setpoint", SPOOL_POSITION.name, "P_A", "P_B", P_S)
    turn = f"{ANGLE.name} 0 {2 * math.pi:.8f} 0 -360"
    hub = "translate(292 76)"
    svg = (
        f'<svg viewBox="0 0 {WIDTH:g} 150">'
        f'<path class="shaft" d="M {160 + _RADIUS:g} 76 H 292"/>'
        f'<g transform="{hub}"><circle class="mass" r="46"/><g data-turn="{turn}">{_SPOKES}'
        '<circle class="steel" r="7"/></g></g>'
        f'<path class="half" d="M {160 - _RADIUS:g} 76 a 34 34 0 0 1 68 0 z" '
        f'data-fill="P_B 0 {top.pressure:.6g}"/>'
        f'<path class="half" d="M {160 - _RADIUS:g} 76 a 34 34 0 0 0 68 0 z" '
        f'data-fill="P_A 0 {top.pressure:.6g}"/>'
        f'<circle class="barrel" cx="160" cy="76" r="{_RADIUS:g}"/>'
        '<path class="sign" d="M 160 110 l -8 -13 h 16 z M 160 42 l -8 13 h 16 z"/>'
        f'<circle class="port" data-port="A" cx="150" cy="{76 + 33:g}" r="2.5"/>'
        f'<circle class="port" data-port="B" cx="170" cy="{76 + 33:g}" r="2.5"/>'
        f'<text x="10" y="20" class="huge" data-text="{ANGLE.name}"/>'
        f'<text x="{WIDTH - 10:g}" y="20" class="right" data-text="speed"/>'
        f'<text x="{WIDTH - 10:g}" y="140" class="right" data-text="torque"/></svg>'
    )
    return Page(svg, plots, top)
