"""Scripts in ``[nodes.NAME.objects]``: objects that live without a plant.

``"0x6401.01" = { sine = 5000, offset = 10000, period_s = 2.0 }`` moves an object over time,
``"0x6401.02" = { follow = "0x6411.01" }`` by what the bus writes to another one.
"""

import math
from collections.abc import Mapping
from itertools import pairwise
from types import MappingProxyType
from typing import Final

from hil_bench.config.objects import parse_object
from hil_bench.config.settings import Key, Problems, Settings, read_table
from hil_bench.config.values import boolean, describe, non_negative, nonzero, number, points, text
from hil_bench.devices.scripted_objects import Course, Points, Sine
from hil_bench.errors import ConfigError
from hil_bench.kinds.scripts import Follow, ScriptConfig
from hil_bench.units import DEGREE, MILLISECOND, ONE, SECOND

FIRST_SCRIPTABLE: Final = 0x2000
_LONGEST = 1e6


def two_values(value: object) -> tuple[float, float]:
    """Return the first and the last value of a ramp.

    Raises:
        ConfigError: the value is something else.
    """
    if not isinstance(value, list) or len(value) != 2:
        raise ConfigError(f"{describe(value)} is no ramp; give [first, last]")
    read = number()
    return read(value[0]), read(value[1])


_DELTA = Key("delta", non_negative)
_OFFSET = Key("offset", number(), 0.0)
_REPEAT = Key("repeat", boolean, default=False)


def _time(name: str, example: str) -> Key:
    read = number(SECOND, low=1e-6, high=_LONGEST)
    return Key(name, read, None, SECOND, example=example)


SCRIPT_KEYS: Final[Mapping[str, tuple[Key, ...]]] = MappingProxyType(
    {
        "constant": (Key("constant", number(), example="1234"), _DELTA),
        "ramp": (
            Key("ramp", two_values, example="[0, 1000]"),
            _time("over_s", "5.0"),
            _REPEAT,
            _DELTA,
        ),
        "sine": (
            Key("sine", number(), example="1000"),
            _OFFSET,
            _time("period_s", "2.0"),
            Key("phase_deg", number(DEGREE), 0.0, DEGREE),
            _DELTA,
        ),
        "table": (Key("table", points(ONE), example="[[0, 0], [1, 1000]]"), _REPEAT, _DELTA),
        "follow": (
            Key("follow", text, example='"0x6411.01"'),
            Key("scale", nonzero, 1.0),
            _OFFSET,
            Key(
                "lag_ms",
                number(MILLISECOND, low=0.0, high=_LONGEST),
                0.0,
                MILLISECOND,
            ),
            _DELTA,
        ),
    }
)
"""The keys of each kind of script; the kind is one of them."""


def is_script(given: object) -> bool:
    """Return True if the value given for an object is a script."""
    return isinstance(given, dict) and bool(given.keys() & SCRIPT_KEYS.keys())


def read_scripts(
    nodes: Mapping[str, Settings], problems: Problems
) -> dict[str, tuple[ScriptConfig, ...]]:
    """Return the scripts of each node; one with a problem is noted and left out."""
    found: dict[str, tuple[ScriptConfig, ...]] = {}
    for node, settings in nodes.items():
        objects = (settings["objects"].value if "objects" in settings else None) or {}
        scripts = (
            _read_script(node, name, given, problems)
            for name, given in objects.items()
            if is_script(given)
        )
        found[node] = tuple(script for script in scripts if script is not None)
    return found


def _read_script(
    node: str, name: str, given: Mapping[str, object], problems: Problems
) -> ScriptConfig | None:
    table = f"nodes.{node}.objects.{name}"
    place = problems.place(table)
    words = sorted(given.keys() & {*SCRIPT_KEYS, "source", "sink"})
    if len(words) > 1:
        problems.add(place, f"is {' and '.join(words)} at once; give one of them")
        return None
    index, subindex = parse_object(name)
    if index < FIRST_SCRIPTABLE:
        problems.add(place, "belongs to the communication services; script one from 0x2000 up")
        return None
    keys = SCRIPT_KEYS[words[0]]
    settings = read_table(table, given, keys, problems)
    if len(settings) < len(keys):
        return None
    try:
        script = _build(words[0], settings)
    except ConfigError as error:
        problems.add(problems.place(table, words[0]), error)
        return None
    return ScriptConfig(index, subindex, script, settings["delta"].value, place)


def _build(word: str, settings: Settings) -> Course | Follow:
    """Return the script of checked keys; ConfigError where they do not go together."""
    if word != "follow":
        return build_course(word, settings)
    scale, offset = settings["scale"].value, settings["offset"].value
    value = settings[word].value
    return Follow(*parse_object(value), scale, offset, settings["lag_ms"].value * 1e-3)


def build_course(word: str, settings: Settings) -> Course:
    """Return the course over time of checked keys; ConfigError where they do not go together."""
    value = settings[word].value
    if word == "constant":
        return Points((0.0,), (value,))
    if word == "ramp":
        return Points((0.0, settings["over_s"].value), value, settings["repeat"].value)
    if word == "sine":
        phase = math.radians(settings["phase_deg"].value)
        return Sine(value, settings["offset"].value, settings["period_s"].value, phase)
    return _build_table(value, repeats=settings["repeat"].value)


def _build_table(value: tuple[tuple[float, float], ...], *, repeats: bool) -> Points:
    if not value:
        raise ConfigError("has no points; give [[time, value], ...]")
    times, values = zip(*value, strict=True)
    if times[0] < 0.0 or any(late <= early for early, late in pairwise(times)):
        raise ConfigError("its times do not rise from 0 or more; give rising times in seconds")
    return Points(times, values, repeats)
