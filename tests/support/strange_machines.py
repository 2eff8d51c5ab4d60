"""Machines drawn at random for `strange_plant`, each with the data sheet that its owner has.

A machine has a size, a valve that suits it, and about half of the `STRANGE` effects, each of a size
drawn within what machines show. The data sheet is wrong as data sheets are: areas by up to 2 %,
flow by up to 8 %, the spool's frequency by up to 20 %, and it knows nothing of hoses.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from support.built_in_nodes import NODES
from support.strange_plant import Machine

SIZES = ((40, 22), (50, 28), (63, 36), (63, 45), (80, 45))  # mm, bore and rod of ISO 6020-2
STROKES = (160, 200, 250, 320)  # mm
FLOWS = (6, 10, 16, 25, 40, 63, 100)  # l/min at 35 bar an edge
RATED_DROP = 35e5


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """What the owner knows of a machine, in the units of a data sheet."""

    bore: float
    rod: float
    stroke: float
    flow: float
    overlap: float
    frequency: float
    supply: float
    mass: float
    slope: float


@dataclass(frozen=True, kw_only=True)
class Stranger:
    """A machine, its data sheet, and the names of what is strange about it."""

    number: int
    machine: Machine
    sheet: Sheet
    effects: tuple[str, ...]
    warming: float  # K from the first stroke to the last
    into_stop: bool
    cool: float  # of the oil in the first stroke [°C]


def _saturation(rng, m):
    return {"body": m.conductance * rng.uniform(0.9, 3.0)}


def _lands(rng, _m):
    return {"gains": tuple(rng.uniform(0.85, 1.15, 4))}


def _overlaps(rng, m):
    mean = m.overlaps[0]
    spread = rng.uniform(-0.015, 0.015, 4)
    shifted = tuple(float(max(mean + one, -0.005)) for one in spread)
    return {"overlaps": shifted, "null_shift": rng.uniform(-0.015, 0.015)}


def _hoses(rng, m):
    return {
        "dead_a": m.dead_a + rng.uniform(50e-6, 350e-6),
        "dead_b": m.dead_b + rng.uniform(50e-6, 350e-6),
        "hose_modulus": rng.uniform(0.8e9, 4e9),
    }


def _air(rng, _m):
    return {"air": rng.uniform(0.003, 0.03)}


def _oil(rng, _m):
    return {"modulus": rng.uniform(1.2e9, 1.7e9), "modulus_slope": rng.uniform(5.0, 12.0)}


def _stiction(rng, _m):
    return {"stiction": rng.uniform(0.001, 0.006)}


def _flow_force(rng, _m):
    return {"flow_force": rng.uniform(0.005, 0.03)}


def _slew(rng, _m):
    return {"slew": rng.uniform(15.0, 60.0), "delay": rng.uniform(0.5e-3, 3e-3)}


def _sagging(rng, m):
    flow = m.conductance * math.sqrt(m.supply / 2.0)
    return {
        "supply_kind": "sagging",
        "sag": rng.uniform(0.02, 0.12) * m.supply / flow,
        "sag_time": rng.uniform(0.02, 0.1),
    }


def _accumulator(rng, m):
    flow = m.conductance * math.sqrt(m.supply / 2.0)
    return {
        "supply_kind": "accumulator",
        "pump": rng.uniform(0.3, 0.8) * flow,
        "gas": rng.uniform(0.7e-3, 3e-3),
    }


def _line(rng, _m):
    return {"line_length": rng.uniform(1.0, 4.0), "line_inner": rng.uniform(8e-3, 13e-3)}


def _friction(rng, m):
    factor = rng.uniform(1.2, 2.0)
    two = {
        name: (getattr(m, name)[0], factor * getattr(m, name)[1])
        for name in ("coulomb", "static", "viscous")
    }
    return two | {"seal_share": rng.uniform(0.2e-5, 1.5e-5) * m.area_a / 2e-3}


def _leakage(rng, _m):
    return {"leakage": rng.uniform(2e-13, 2e-12), "outer_leakage": rng.uniform(0.0, 3e-13)}


def _knee(rng, _m):
    return {"knee": rng.uniform(0.05, 0.15)}


STRANGE = {
    "flow saturation in the body": (_saturation, 0.6),
    "unequal lands": (_lands, 0.5),
    "four overlaps and a shifted null": (_overlaps, 0.6),
    "hoses": (_hoses, 0.6),
    "air": (_air, 0.5),
    "modulus by pressure": (_oil, 0.7),
    "spool stiction": (_stiction, 0.4),
    "flow force": (_flow_force, 0.4),
    "slew limit and delay": (_slew, 0.4),
    "sagging supply": (_sagging, 0.25),
    "accumulator": (_accumulator, 0.2),
    "line": (_line, 0.25),
    "two-sided friction": (_friction, 0.5),
    "leakage": (_leakage, 0.4),
    "two-slope areas": (_knee, 0.15),
}


def draw(seed: int, number: int) -> Stranger:
    """Draw a machine: the same for the same seed and number."""
    rng = np.random.default_rng([seed, number])
    bore, rod = SIZES[rng.integers(len(SIZES))]
    stroke = STROKES[rng.integers(len(STROKES))]
    supply = float(rng.choice([70.0, 100.0, 140.0, 210.0])) * 1e5
    area_a = 0.25 * math.pi * (bore * 1e-3) ** 2
    area_b = area_a - 0.25 * math.pi * (rod * 1e-3) ** 2
    flow = area_a * rng.uniform(0.25, 0.7) / math.sqrt(0.5 * supply)
    rated = min(FLOWS, key=lambda one: abs(math.log(one / 6e4 / math.sqrt(RATED_DROP) / flow)))
    overlap = float(rng.choice([0.0, 0.02, 0.05, 0.15]))
    conductance = rated / 6e4 / math.sqrt(RATED_DROP) / (1.0 - overlap)
    vertical = rng.random() < 0.3
    mass = rng.uniform(0.5, 1.0) * 0.15 * supply * area_b / 9.81
    omega = 2.0 * math.pi * float(rng.uniform(40.0, 120.0))
    dry = rng.uniform(1.0, 4.0) * 1e5 * area_a
    viscous = rng.uniform(0.5, 2.0) * 4e5 * area_a
    machine = Machine(
        area_a=area_a * rng.uniform(0.98, 1.02),
        area_b=area_b * rng.uniform(0.98, 1.02),
        stroke=stroke * 1e-3,
        mass=mass * rng.uniform(0.9, 1.1),
        gravity_share=1.0 if vertical else 0.0,
        dead_a=0.05 * area_a * stroke * 1e-3 * rng.uniform(0.5, 2.0),
        dead_b=0.05 * area_b * stroke * 1e-3 * rng.uniform(0.5, 2.0),
        coulomb=(dry, dry),
        static=(1.5 * dry, 1.5 * dry),
        viscous=(viscous, viscous),
        conductance=conductance * rng.uniform(0.92, 1.08),
        overlaps=(overlap,) * 4,
        rounding=rng.uniform(0.002, 0.01),
        laminar=rng.uniform(5e3, 5e4),
        omega=omega * rng.uniform(0.8, 1.2),
        damping=rng.uniform(0.6, 1.0),
        supply=supply * rng.uniform(0.97, 1.03),
        tank=rng.uniform(0.0, 4e5),
        modulus=rng.uniform(1.2e9, 1.6e9),
        air=rng.uniform(0.0005, 0.002),
    )
    effects = []
    for name, (effect, share) in STRANGE.items():
        sizes, is_on = effect(rng, machine), rng.random() < share
        if is_on and not (name == "accumulator" and machine.supply_kind != "constant"):
            machine = replace(machine, **sizes)
            effects.append(name)
    sheet = Sheet(
        bore=bore,
        rod=rod,
        stroke=stroke,
        flow=rated,
        overlap=100.0 * overlap,
        frequency=round(omega / (2.0 * math.pi)),
        supply=supply / 1e5,
        mass=round(mass),
        slope=90.0 if vertical else 0.0,
    )
    return Stranger(
        number=number,
        machine=machine,
        sheet=sheet,
        effects=tuple(effects),
        warming=rng.uniform(0.0, 4.0),
        into_stop=bool(rng.random() < 0.5),
        cool=rng.uniform(30.0, 50.0),
    )


def write_sheet(sheet: Sheet) -> str:
    """The bench.toml that the owner writes from data sheets."""
    overlap = f"overlap_percent = {sheet.overlap:g}\n"
    return f"""\
[plant.axis1]
bore_mm = {sheet.bore:g}
rod_mm = {sheet.rod:g}
stroke_mm = {sheet.stroke:g}
rated_flow_l_min = {sheet.flow:g}
rated_pressure_drop_bar = {RATED_DROP / 1e5:g}
{overlap}frequency_90deg_hz = {sheet.frequency:g}
oil = "HLP 46"
supply_pressure_bar = {sheet.supply:g}
load_mass_kg = {sheet.mass:g}
load_slope_deg = {sheet.slope:g}
{NODES}"""
