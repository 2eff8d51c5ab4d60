"""Orifices and dynamics of a valve from its data sheet."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from hil_bench.plants.hydraulic_cylinder.data_sheet.oil import Derived, Sheet
from hil_bench.plants.hydraulic_cylinder.keys import VALVE_SHEET
from hil_bench.plants.hydraulic_cylinder.model.orifice import edge_opening

RESPONSE = 0.9
"""Share of a step that the spool has made after `step_response_ms`."""

DAMPING_RATIO = 0.7
"""A typical damping ratio of a spool's position loop: near -3 dB at -90 degrees."""

SPOOL_STROKE_MM = 1.0
"""The stroke of a spool of which none is given: flows depend on the share of it alone."""

_NAMES = tuple(key.name for key in VALVE_SHEET)
_RATED = ("rated_flow_l_min", "rated_pressure_drop_bar")
_LEAKAGE = ("null_leakage_l_min", "null_leakage_pressure_bar")
_EDGES = ("pa", "at", "pb", "bt")
_OPENING = ("orifice_full_opening_mm", "spool_overlap_mm")
_DYNAMICS = ("frequency_90deg_hz", "step_response_ms", "spool_natural_frequency_rad_s")


def orifice_width(
    flow: float, drop: float, *, full_opening: float, discharge: float, density: float
) -> float:
    """Return w = Q / (C_d alpha sqrt(2 dp / rho)) of an edge [m] (Ruderman 2017 eqs. (5), (7)).

    Args:
        flow: through one edge of the wide open valve [m³/s].
        drop: of the pressure over that edge [Pa].
        full_opening: alpha [m].
        discharge: C_d [-].
        density: of the oil [kg/m³].
    """
    return flow / (discharge * full_opening * math.sqrt(2.0 * drop / density))


def step_response(angle: float, damping: float) -> float:
    """Return the unit step response of a second-order lag at omega_0 t = angle."""
    root = math.sqrt(abs(1.0 - damping * damping))
    mu, decay = angle * root, math.exp(-damping * angle)
    if root < 1e-6:
        return 1.0 - decay * (1.0 + angle)
    if damping < 1.0:
        return 1.0 - decay * (math.cos(mu) + damping / root * math.sin(mu))
    slow, fast = math.exp(mu - damping * angle), math.exp(-mu - damping * angle)
    even, odd = 0.5 * (slow + fast), 0.5 * (slow - fast)
    return 1.0 - even - damping / root * odd


def natural_frequency(time: float, damping: float) -> float:
    """Return omega_0 [rad/s] of a second-order lag that first reaches 90 % of a step after a time.

    Args:
        time: to 90 % [s].
        damping: ratio of the lag [-].
    """
    low, high = 0.0, 1.0
    while step_response(high, damping) < RESPONSE:
        low, high = high, high + 0.5
    for _ in range(60):
        middle = 0.5 * (low + high)
        if step_response(middle, damping) < RESPONSE:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high) / time


def saturation(half: float) -> float:
    """Return s of the flow a sqrt((1 + s) / (1 + s a²)) that is `half` at a = 1/2.

    With half² = (1 + s) / (4 + s): s = (4 half² - 1) / (1 - half²).
    """
    return (4.0 * half * half - 1.0) / (1.0 - half * half)


class NullEdge(NamedTuple):
    """An edge of the spool in its centre.

    Attributes:
        overlap: dead zone [m].
        largest: opening of the wide open edge [m].
        gain: of the edge [-].
    """

    overlap: float
    largest: float
    gain: float


def null_flow(x_0: float, edges: Sequence[NullEdge], saturation: float) -> float:
    """Return the leakage of a centred spool with blocked ports, over K sqrt(P_S - P_T) [m].

    The edges of each port are in series: a_1 a_2 / sqrt(a_1² + a_2²) for A, and the same for B.

    Args:
        x_0: opening that leaks [m].
        edges: P-A, A-T, P-B and B-T.
        saturation: s of the flow [-].
    """
    a = [edge_opening(-edge.overlap, edge.largest, edge.gain, x_0, saturation) for edge in edges]
    pairs = ((a[0], a[1]), (a[2], a[3]))
    return sum(one * two / math.hypot(one, two) for one, two in pairs if one and two)


def null_opening(flow: float, edges: Sequence[NullEdge], saturation: float) -> float | None:
    """Return the x_0 [m] with which a centred spool leaks; None where no x_0 can.

    Args:
        flow: of the leakage over K sqrt(P_S - P_T) [m].
        edges: P-A, A-T, P-B and B-T.
        saturation: s of the flow [-].
    """
    low, high = 0.0, 0.9 * min(edge.largest for edge in edges)
    if not null_flow(low, edges, saturation) < flow < null_flow(high, edges, saturation):
        return None
    for _ in range(60):
        middle = 0.5 * (low + high)
        if null_flow(middle, edges, saturation) < flow:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def derive_valve(sheet: Sheet, density: float) -> Iterator[Derived]:
    """Yield what rated flow, overlap and dynamics determine.

    Args:
        sheet: of the axis.
        density: of the oil [kg/m³].
    """
    given = sheet.given(_NAMES)
    if not given:
        return
    yield from _derive_dynamics(sheet, given[0])
    lands = list(_derive_lands(sheet))
    yield from lands
    if not sheet.require(given[0], zip(_RATED, ("60", "5"), strict=True)):
        return
    opening = sheet.number("orifice_full_opening_mm")
    overlap = sheet.number("spool_overlap_mm")
    sources = _RATED
    if sheet.has("overlap_percent") or not sheet.has(*_OPENING):
        if not sheet.require(given[0], [("overlap_percent", "15, or 0 for a servo-valve")]):
            return
        stroke = sheet.number("spool_stroke_mm", SPOOL_STROKE_MM)
        share = sheet.number("overlap_percent") * 1e-2
        opening = stroke * (1.0 - share)
        own = sheet.given(("spool_stroke_mm", "overlap_percent"))
        typical = (
            "" if sheet.has("spool_stroke_mm") else "a stroke of 1 mm, which no flow depends on"
        )
        yield Derived("orifice_full_opening_mm", opening, own, typical)
        overlap = stroke * share
        yield Derived("spool_overlap_mm", overlap, own, typical)
    discharge = sheet.number("discharge_coefficient")
    if not (opening > 0.0 and discharge > 0.0 and density > 0.0):
        return  # refused by the plant itself
    flow, drop = sheet.si(_RATED[0]), sheet.si(_RATED[1])
    width = orifice_width(
        flow, drop, full_opening=opening * 1e-3, discharge=discharge, density=density
    )
    yield Derived("orifice_width_mm", width * 1e3, sources)
    if sheet.given(_LEAKAGE):
        conductance = flow / (opening * 1e-3 * math.sqrt(drop))
        yield from _derive_leakage(sheet, conductance, opening, overlap, lands)


def _derive_leakage(
    sheet: Sheet, conductance: float, opening: float, overlap: float, lands: Sequence[Derived]
) -> Iterator[Derived]:
    """Yield the opening that leaks.

    Args:
        sheet: of the axis.
        conductance: K [m²/(s sqrt(Pa))].
        opening: of the wide open spool beyond its overlap [mm].
        overlap: of the spool [mm].
        lands: what the sheet says of the edges.
    """
    if not sheet.require(sheet.given(_LEAKAGE)[0], zip(_LEAKAGE, ("1.5", "210"), strict=True)):
        return
    derived = {each.key: each.value for each in lands}
    edges = []
    for name in _EDGES:
        own = sheet.number(f"land_overlap_{name}_mm", overlap)
        gain = derived.get(f"land_gain_{name}", sheet.number(f"land_gain_{name}"))
        edges.append(NullEdge(own * 1e-3, (opening + overlap - own) * 1e-3, gain))
    flow = sheet.si(_LEAKAGE[0]) / (conductance * math.sqrt(sheet.si(_LEAKAGE[1])))
    bent = derived.get("flow_saturation", sheet.number("flow_saturation"))
    x_0 = null_opening(flow, edges, bent) if all(edge.largest > 0.0 for edge in edges) else None
    if x_0 is None:
        given = sheet.number(_LEAKAGE[0])
        right = "give a leakage between that of the spool's underlap and the rated flow"
        sheet.refuse(_LEAKAGE[0], f"{given:g} l/min is no leakage of these edges; {right}")
        return
    yield Derived("null_opening_um", x_0 * 1e6, (*_LEAKAGE, *_RATED))


def _derive_lands(sheet: Sheet) -> Iterator[Derived]:
    if sheet.has("ratio_a_b"):
        gain = 1.0 / sheet.number("ratio_a_b")
        yield Derived("land_gain_pb", gain, ("ratio_a_b",))
        yield Derived("land_gain_bt", gain, ("ratio_a_b",))
    half = "flow_at_half_opening_percent"
    if sheet.has(half):
        yield Derived("flow_saturation", saturation(sheet.si(half)), (half,))


def _derive_dynamics(sheet: Sheet, cause: str) -> Iterator[Derived]:
    found = sheet.given(_DYNAMICS)
    if not found:
        right = "give for example frequency_90deg_hz = 60, or step_response_ms"
        sheet.refuse(_DYNAMICS[0], f"missing; {cause} is given and needs it; {right}")
        return
    if len(found) > 1:
        sheet.refuse(found[1], f"given twice: {found[0]} says it too; leave one of them out")
        return
    has_damping = sheet.has("spool_damping_ratio")
    damping = sheet.number("spool_damping_ratio") if has_damping else DAMPING_RATIO
    if not has_damping:
        yield Derived(
            "spool_damping_ratio", damping, typical="near -3 dB at -90 degrees", yields=True
        )
    if found[0] == "frequency_90deg_hz":
        omega = 2.0 * math.pi * sheet.number(found[0])
    elif found[0] == "step_response_ms" and 0.0 < damping <= 100.0:
        omega = natural_frequency(sheet.si(found[0]), damping)
    else:
        return
    yield Derived("spool_natural_frequency_rad_s", omega, (found[0],))
