"""Orifices and dynamics of a valve from its data sheet."""

import math
from collections.abc import Iterator

from hil_bench.plants.hydraulic_cylinder.data_sheet.sheet import Derived, Sheet
from hil_bench.plants.hydraulic_cylinder.data_sheet_keys import VALVE_KEYS

RESPONSE = 0.9
"""Share of a step that the spool has made after `step_response_ms`."""

DAMPING_RATIO = 0.7
"""A typical damping ratio of a spool's position loop: near -3 dB at -90 degrees."""

SPOOL_STROKE_MM = 1.0
"""The stroke of a spool of which none is given: flows depend on the share of it alone."""

_NAMES = tuple(key.name for key in VALVE_KEYS)
_RATED = ("rated_flow_l_min", "rated_pressure_drop_bar")
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
    """Return what a second-order lag shows of a unit step at omega_0 t = angle."""
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
    yield from _derive_lands(sheet)
    if not sheet.require(given[0], zip(_RATED, ("60", "5"), strict=True)):
        return
    opening = sheet.number("orifice_full_opening_mm")
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
        yield Derived("spool_overlap_mm", stroke * share, own, typical)
    discharge = sheet.number("discharge_coefficient")
    if not (opening > 0.0 and discharge > 0.0 and density > 0.0):
        return  # refused by the plant itself
    flow, drop = sheet.si(_RATED[0]), sheet.si(_RATED[1])
    width = orifice_width(
        flow, drop, full_opening=opening * 1e-3, discharge=discharge, density=density
    )
    yield Derived("orifice_width_mm", width * 1e3, sources)


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
