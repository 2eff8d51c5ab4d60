"""Data in the words of an order: ``63/36x500``, ``60 l/min @ 5 bar, overlap 15 %, 40 Hz``."""

import re
from typing import Final, NamedTuple

from hil_bench.errors import ConfigError

# Generic sizes: cylinders by ISO 6020-2 and ISO 6022, valves by their nominal size.


class ValveSize(NamedTuple):
    """A typical proportional or servo-valve.

    Attributes:
        rated_flow: through an edge of the wide open valve [l/min].
        rated_drop: over that edge [bar].
        overlap: of the spool's stroke [%].
        frequency: at which the spool lags by 90 degrees, at a small amplitude [Hz].
    """

    rated_flow: float
    rated_drop: float
    overlap: float
    frequency: float


VALVES: Final[dict[str, ValveSize]] = {
    "NG6": ValveSize(25.0, 5.0, 15.0, 60.0),
    "NG10": ValveSize(60.0, 5.0, 15.0, 40.0),
    "NG16": ValveSize(150.0, 5.0, 15.0, 30.0),
    "NG25": ValveSize(300.0, 5.0, 15.0, 20.0),
    "servo NG6": ValveSize(20.0, 35.0, 0.0, 120.0),
    "servo NG10": ValveSize(40.0, 35.0, 0.0, 100.0),
    "servo NG16": ValveSize(150.0, 35.0, 0.0, 60.0),
}
"""By nominal size: direct operated up to NG10, with a pilot above."""

CYLINDERS: Final[dict[str, dict[int, tuple[int, ...]]]] = {
    "ISO 6020-2, 160 bar": {
        25: (12, 18),
        32: (14, 22),
        40: (18, 28),
        50: (22, 28, 36),
        63: (28, 36, 45),
        80: (36, 45, 56),
        100: (45, 56, 70),
        125: (56, 70, 90),
        160: (70, 90, 110),
        200: (90, 110, 140),
    },
    "ISO 6022, 250 bar": {
        50: (32, 36),
        63: (40, 45),
        80: (50, 56),
        100: (63, 70),
        125: (80, 90),
        160: (100, 110),
        200: (125, 140),
        250: (160, 180),
        320: (200, 220),
    },
}
"""The rods of each bore [mm], by standard and its nominal pressure."""


def describe_cylinder(bore: float, rod: float) -> str:
    """Return the standards that have a bore with a rod [mm]; empty without any."""
    standards = [name for name, bores in CYLINDERS.items() if rod in bores.get(int(bore), ())]
    return " and ".join(standards) if bore == int(bore) else ""


def catalogue_lines() -> list[str]:
    """Return the catalogue as lines."""
    lines = ["valves: rated flow @ pressure drop of an edge, overlap, frequency at -90 degrees"]
    lines += [
        f"  {name:12} {each.rated_flow:g} l/min @ {each.rated_drop:g} bar, "
        f"{each.overlap:g} %, {each.frequency:g} Hz"
        for name, each in VALVES.items()
    ]
    for standard, bores in CYLINDERS.items():
        lines += ["", f"cylinders: bore/rod [mm], {standard}"]
        lines += ["  " + "  ".join(f"{bore}/{rod}" for rod in rods) for bore, rods in bores.items()]
    return lines


# Data in the words of an order: ``63/36x500``, ``60 l/min @ 5 bar, overlap 15 %, 40 Hz``.

_NUMBER = r"(\d+(?:\.\d+)?)"
_CYLINDER: Final = re.compile(
    rf"\s*{_NUMBER}\s*/\s*{_NUMBER}(?:\s*/\s*{_NUMBER})?\s*[x×*]\s*{_NUMBER}\s*(?:mm)?\s*",
    re.IGNORECASE,
)
_FLOW: Final = re.compile(rf"{_NUMBER}\s*l/min\s*@\s*{_NUMBER}\s*bar", re.IGNORECASE)
_OVERLAP: Final = re.compile(rf"overlap\s*{_NUMBER}\s*%", re.IGNORECASE)
_FREQUENCY: Final = re.compile(rf"{_NUMBER}\s*Hz", re.IGNORECASE)
_RESPONSE: Final = re.compile(rf"{_NUMBER}\s*ms", re.IGNORECASE)

CYLINDER_EXAMPLE: Final = "63/36x500"
VALVE_EXAMPLE: Final = "60 l/min @ 5 bar, overlap 15 %, 40 Hz"

_SERVO_DROP = 35.0
_TYPICAL_SIZE = {True: "servo NG10", False: "NG10"}


class Datum(NamedTuple):
    """One key of a bench.toml and where its value comes from.

    Attributes:
        key: of ``[plant.NAME]``.
        value: in the key's unit.
        origin: who says so.
    """

    key: str
    value: float | str
    origin: str


def read_cylinder(text: str, origin: str) -> list[Datum]:
    """Return bore, rods and stroke of ``BORE/RODxSTROKE`` [mm]; a second rod stands behind a /.

    Raises:
        ConfigError: it is none, or a rod is not thinner than the bore.
    """
    found = _CYLINDER.fullmatch(text)
    right = f'give BORE/RODxSTROKE in mm, such as "{CYLINDER_EXAMPLE}"'
    if found is None:
        raise ConfigError(f'"{text}" is no cylinder; {right}')
    bore, rod, second, stroke = (None if each is None else float(each) for each in found.groups())
    for each in (rod, second):
        if each is not None and bore is not None and each >= bore:
            raise ConfigError(f'"{text}": the rod of {each:g} mm fills the bore; {right}')
    standards = describe_cylinder(bore or 0.0, rod or 0.0)
    size = f"{origin}, a size of {standards}" if standards else origin
    data = [Datum("bore_mm", bore or 0.0, size), Datum("rod_mm", rod or 0.0, origin)]
    if second is not None:
        data.append(Datum("second_rod_mm", second, origin))
    return [*data, Datum("stroke_mm", stroke or 0.0, origin)]


def read_valve(text: str, origin: str) -> list[Datum]:
    """Return the data of a valve: a size of the catalogue, or flow, overlap and dynamics.

    Raises:
        ConfigError: it is none.
    """
    names = {name.lower(): name for name in VALVES}
    name = names.get(" ".join(text.lower().split()))
    if name is not None:
        return _size_data(VALVES[name], f"typical of {name}, catalogue")
    flow, *rest = (part.strip() for part in text.split(","))
    rated = _FLOW.fullmatch(flow)
    if rated is None:
        known = ", ".join(VALVES)
        right = f'give "{VALVE_EXAMPLE}", where the last two may be left out, or one of {known}'
        raise ConfigError(f'"{text}" is no valve; {right}')
    drop = float(rated[2])
    data = {
        "rated_flow_l_min": Datum("rated_flow_l_min", float(rated[1]), origin),
        "rated_pressure_drop_bar": Datum(
            "rated_pressure_drop_bar", drop, f"{origin}, over one edge"
        ),
    }
    for part in rest:
        datum = _read_part(part, origin)
        data[datum.key] = datum
    size = _TYPICAL_SIZE[drop >= _SERVO_DROP]
    for each in _size_data(VALVES[size], f"typical of {size}: look it up in the data sheet")[2:]:
        is_known = each.key == "frequency_90deg_hz" and "step_response_ms" in data
        if not is_known:
            data.setdefault(each.key, each)
    return list(data.values())


def _read_part(part: str, origin: str) -> Datum:
    for pattern, key in (
        (_OVERLAP, "overlap_percent"),
        (_FREQUENCY, "frequency_90deg_hz"),
        (_RESPONSE, "step_response_ms"),
    ):
        if found := pattern.fullmatch(part):
            return Datum(key, float(found[1]), origin)
    raise ConfigError(f'"{part}" is no datum of a valve; give "overlap 15 %", "40 Hz" or "20 ms"')


def _size_data(size: ValveSize, origin: str) -> list[Datum]:
    return [
        Datum("rated_flow_l_min", size.rated_flow, origin),
        Datum("rated_pressure_drop_bar", size.rated_drop, origin),
        Datum("overlap_percent", size.overlap, origin),
        Datum("frequency_90deg_hz", size.frequency, origin),
    ]
