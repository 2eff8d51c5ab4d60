"""The words of `hil-bench ctl` as requests: settings with their units."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from hil_bench.cli.arguments import parse_value
from hil_bench.errors import ConfigError
from hil_bench.units import BAR, MEGAPASCAL, NEWTON, NEWTON_METRE, PASCAL, Unit

_UNITS: Mapping[str, Sequence[Unit]] = {
    "N": (NEWTON,),
    "N m": (NEWTON_METRE,),
    "Pa": (BAR, PASCAL, MEGAPASCAL),
}
"""In which what acts on a plant is given, by its SI unit."""

_RIGHT_SET = "give AXIS.QUANTITY_UNIT=NUMBER or NODE.OBJECT=VALUE"


class LiveSetting(NamedTuple):
    """The setting that a user asks for.

    Attributes:
        action: the request: "set_plant" or "set_object".
        fields: its fields.
    """

    action: str
    fields: dict[str, Any]


def read_setting(word: str, hello: Mapping[str, Any]) -> LiveSetting:
    """Return the request for ``axis1.load_n=5000``, ``io.0x6401.01=1234`` or ``joystick.x=50``.

    Raises:
        ConfigError: it is wrong.
    """
    path, sign, text = word.partition("=")
    place, dot, name = path.partition(".")
    if not (sign and dot and name):
        raise ConfigError(f"set {word}: {_RIGHT_SET}")
    if place in hello["axes"]:
        quantity, unit = _influence(place, name, hello["axes"][place])
        value = parse_value(text)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise ConfigError(f"set {word}: {text} is not a number")
        _check_finite(word, value)
        fields = {"axis": place, "quantity": quantity, "value": unit.to_si(value)}
        return LiveSetting("set_plant", fields)
    if place in {*hello["nodes"], *hello.get("ecus", {})}:
        held = _object_value(text)
        _check_finite(word, held)
        return LiveSetting("set_object", {"node": place, "name": name, "value": held})
    known = ", ".join([*hello["axes"], *hello["nodes"], *hello.get("ecus", {})])
    raise ConfigError(f'set {word}: there is no axis or node "{place}"; give one of {known}')


def _influence(axis: str, name: str, influences: Sequence[Mapping[str, Any]]) -> tuple[str, Unit]:
    known = {}
    for influence in influences:
        for unit in _UNITS.get(influence["unit"], (Unit(influence["unit"], ""),)):
            known[influence["name"] + unit.suffix] = (influence["name"], unit)
    if name not in known:
        right = f"give {', '.join(known)}" if known else "nothing of its plant can be set"
        raise ConfigError(f"set {axis}.{name}: cannot be set; {right}")
    return known[name]


def _check_finite(word: str, value: object) -> None:
    """Refuse a number that is none.

    Raises:
        ConfigError: it is.
    """
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"set {word}: {value:g} is not finite; give a number")


def _object_value(text: str) -> object:
    """Return a value for an object; bytes are ``hex:00ff``.

    Raises:
        ConfigError: it is none.
    """
    if text.startswith("hex:"):
        try:
            return {"hex": bytes.fromhex(text[4:]).hex()}
        except ValueError:
            raise ConfigError(f"set: {text}: give an even number of hexadecimal digits") from None
    value = parse_value(text)
    return value if isinstance(value, (str, bool, int, float)) else text
