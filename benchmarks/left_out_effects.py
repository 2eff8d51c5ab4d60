"""Effects that the bench's plant leaves out or simplifies: how large each is on a plain cylinder.

Run: `python benchmarks/left_out_effects.py`.

The cylinder is 50/28 x 250 with 120 kg, a valve of 40 l/min at 35 bar an edge and 140 bar, as
`tests/support/strange_plant.py` has it, which knows these effects. Each is turned on alone, at a
size from data sheets and text books, and strokes into both end stops at 35 % and 85 % of the
command are compared with those of the plain cylinder. Prints the table of docs/plant.md: the
largest change over the four strokes. Mean pressures are those of steady motion; "in transients" is
the root mean square over a stroke of the pressure in chamber A.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import occasion
from stranger_prediction import TICK, Errors, Shown, Stroke, Values, errors_of

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.strange_plant import Machine, modulus_at, rest_state, run_stroke

PLAIN = Machine(leakage=3e-13, air=0.005)
COMMANDS = (0.35, -0.35, 0.85, -0.85)
LAG = 5e-3  # [s] of a sensor behind a metre of thin tube
SAG = 0.05 * PLAIN.supply / (PLAIN.conductance * np.sqrt(0.5 * PLAIN.supply))
MEAN_PRESSURE = 60e5
SLOPE = 8.0
"""Rise of the modulus of mineral oil with pressure [Pa/Pa]."""


class Effect(NamedTuple):
    """An effect: in words, and what of the plain machine it changes."""

    name: str
    changes: dict[str, Any] = {}  # noqa: RUF012 - read only
    temperature: float | None = None
    lag: float = 0.0


def _without_slope() -> float:
    """Return the modulus that at the mean pressure is as the sloped one."""
    return PLAIN.modulus - SLOPE * MEAN_PRESSURE


EFFECTS = (
    Effect("flow force, position loop: 1 % of the stroke", {"flow_force": 0.01}),
    Effect("flow force, no position loop: 5 %", {"flow_force": 0.05}),
    Effect("spool stiction, position loop: 0.3 %", {"stiction": 0.003}),
    Effect("spool stiction, no position loop: 2 %", {"stiction": 0.02}),
    Effect("valve body, three times an edge's conductance", {"body": 3.0 * PLAIN.conductance}),
    Effect("edges rounded over 1 % of the stroke instead of 0.4 %", {"rounding": 0.01}),
    Effect("half the slope below 10 % opening", {"knee": 0.1}),
    Effect("slew limit, 25 strokes a second", {"slew": 25.0}),
    Effect("valve delay, 2 ms", {"delay": 2e-3}),
    Effect("sensor tubing: lag of 5 ms of a pressure", lag=LAG),
    Effect(
        "modulus by pressure, 8 Pa/Pa, equal at 60 bar",
        {"modulus": _without_slope(), "modulus_slope": SLOPE},
    ),
    Effect("oil at 60 instead of 40 °C", temperature=60.0),
    Effect("oil at 20 instead of 40 °C", temperature=20.0),
    Effect("2 % of air instead of 0.5 %", {"air": 0.02}),
    Effect("2 m of line of 10 mm, its volume counted", {"line_length": 2.0, "line_inner": 10e-3}),
    Effect(
        "its volume alone",
        {"dead_a": PLAIN.dead_a + 157e-6, "dead_b": PLAIN.dead_b + 157e-6},
    ),
    Effect("pump that sags by 5 %", {"supply_kind": "sagging", "sag": float(SAG)}),
    Effect(
        "friction half as large again retracting",
        {"coulomb": (300.0, 450.0), "static": (450.0, 675.0), "viscous": (900.0, 1350.0)},
    ),
    Effect("friction that grows with pressure, 10 N/MPa", {"seal_share": 1e-5}),
)


def strokes_of(machine: Machine, effect: Effect, commands: Sequence[float]) -> list[Stroke]:
    """Return strokes of a machine, one after the other."""
    state, strokes = rest_state(machine, -0.49 * machine.stroke), []
    for command in commands:
        run = run_stroke(machine, state, command, temperature=effect.temperature)
        state = run.end
        times = np.arange(0.0, run.time[-1], TICK)
        x, first, second = (
            np.interp(times, run.time, one) for one in (run.x, run.pressure_a, run.pressure_b)
        )
        command_rows = np.interp(times, run.time, run.command)
        strokes.append(
            Stroke(command_rows, x, _late(first, effect.lag), _late(second, effect.lag), np.nan)
        )
    return strokes


def _late(values: Values, lag: float) -> Values:
    """Return values behind a lag of first order."""
    if not lag:
        return values
    share, shown, late = 1.0 - np.exp(-TICK / lag), float(values[0]), np.empty_like(values)
    for row, value in enumerate(values.tolist()):
        shown += share * (value - shown)
        late[row] = shown
    return late


def compare(plain: Stroke, changed: Stroke) -> tuple[Errors, float]:
    """Return the changes by an effect, and the rms of the change of P_A [Pa]."""
    rows = min(len(plain.x), len(changed.x))
    shown = Shown(*(one[:rows] for one in changed[1:4]))
    base = Stroke(*(one[:rows] for one in plain[:4]), plain.supply)
    errors = errors_of(base, shown, ("P_A", "P_B"))
    return errors, float(np.sqrt(np.mean(np.square(base.P_A - shown.P_A))))


def main() -> None:
    """Compute and print."""
    parser = argparse.ArgumentParser()
    args = occasion.arguments(parser)
    commands = COMMANDS[2:3] if args.brief else COMMANDS
    plain = strokes_of(PLAIN, Effect("plain"), commands)
    shown = ", ".join(
        f"{modulus_at(PLAIN, p) / 1e6:.0f} MPa at {p / 1e5:g} bar" for p in (5e5, 6e6)
    )
    print(f"effective modulus of the plain cylinder's oil: {shown}\n")
    print("| effect | speed | mean pressure | in transients | arrival | position, rms |")
    print("|---|---|---|---|---|---|")
    for effect in EFFECTS[: 3 if args.brief else None]:
        machine = replace(PLAIN, **effect.changes)
        pairs = zip(plain, strokes_of(machine, effect, commands), strict=True)
        changes = [compare(*pair) for pair in pairs]
        e = Errors(*np.max([one for one, _ in changes], axis=0).tolist())
        swing = max(one for _, one in changes)
        cells = (
            effect.name,
            f"{e.speed:.1%}",
            f"{e.pressure / 1e5:.1f} bar",
            f"{swing / 1e5:.1f} bar",
            f"{e.arrival * 1e3:.0f} ms",
            f"{e.position * 1e3:.1f} mm",
        )
        print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
