"""A design for people and for programs."""

from typing import Any

import numpy as np

from hil_bench.abilities.identification.design.choosing import Design, Outlook
from hil_bench.abilities.identification.machine import UNITS
from hil_bench.units import BAR, MILLIMETRE, MILLIMETRE_PER_SECOND

REACH = 1.96
"""Standard deviations on each side of a 95 % interval."""

_SHOWN = 8  # candidates


def summarise_design(design: Design, notes: tuple[str, ...] = ()) -> str:
    """Return a design as people read it.

    Args:
        design: what was chosen.
        notes: what it rests on, a line each.
    """
    ranking = design.ranking[:_SHOWN]
    refused = sum(design.refused.values())
    lines = [
        f"{design.axis}: {len(design.ranking)} manoeuvres compared"
        + (f", {refused} more would leave the limits" if refused else ""),
        *notes,
        "",
        f"{'manoeuvre':44} {'time':>6} {'uncertainty left':>17}  best for",
        *(
            (
                f"{one.name:44} {one.duration:4.1f} s {100.0 * one.left:15.2g} %  "
                + ", ".join(one.best_for)
            ).rstrip()
            for one in ranking
        ),
    ]
    if len(design.ranking) > len(ranking):
        lines.append(f"... and {len(design.ranking) - len(ranking)} that take less of it a second")
    lines += ["", f"the run, {design.duration:.1f} s:"]
    lines += [f"  from {time:5.1f} s  {name}" for time, name in design.names]
    lines += [
        "",
        f"{'parameter':32} {'value':>12} {'95 % today':>14} {'95 % after it':>14}",
        *map(_line, design.outlooks),
    ]
    vague = [one.name for one in design.outlooks if not one.is_told_after]
    if vague:
        lines += ["", f"not identifiable even then: {', '.join(vague)}"]
    return "\n".join([*lines, "", _motion(design)])


def design_to_json(design: Design) -> dict[str, Any]:
    """Return a design for programs, in the keys and units of `bench.toml`."""
    return {
        "axis": design.axis,
        "duration_s": design.duration,
        "manoeuvres": [{"at_s": time, "name": name} for time, name in design.names],
        "ranking": [
            {
                "name": one.name,
                "duration_s": one.duration,
                "uncertainty_left": one.left,
                "best_for": [*one.best_for],
            }
            for one in design.ranking
        ],
        "left_the_limits": design.refused,
        "parameters": {
            one.name: {
                "value": one.value,
                "standard_deviation_today": one.before,
                "standard_deviation_after": one.after,
                "is_told_today": one.is_told_before,
                "is_told_after": one.is_told_after,
                "unit": UNITS.get(one.name, ""),
            }
            for one in design.outlooks
        },
    }


def _line(one: Outlook) -> str:
    before, after = REACH * one.before, REACH * one.after
    today = f"+- {before:.2g}" if one.is_told_before else "unknown"
    return f"{one.name:32} {one.value:12.6g} {today:>14} +- {after:11.2g}"


def _motion(design: Design) -> str:
    x, v, pressures = design.states[:, 0], design.states[:, 1], design.states[:, 2:]
    return (
        f"expected motion: from {MILLIMETRE.from_si(design.start):.0f} mm to between "
        f"{MILLIMETRE.from_si(x.min()):.0f} and {MILLIMETRE.from_si(x.max()):.0f} mm, up to "
        f"{MILLIMETRE_PER_SECOND.from_si(float(np.abs(v).max())):.0f} mm/s, "
        f"{BAR.from_si(pressures.min()):.0f} to {BAR.from_si(pressures.max()):.0f} bar"
    )
