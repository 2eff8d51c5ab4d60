"""The keys of a scenario file: name, unit, default; docs/scenarios.md says what each means."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from hil_bench.abilities.controllers.power import Power
from hil_bench.abilities.scenario.records import NmtVerb
from hil_bench.bench.configuration.fault_keys import COMMON_KEYS, OWN_KEYS
from hil_bench.config.settings import Key
from hil_bench.config.values import boolean, choice, describe, number, text, texts
from hil_bench.devices.faults.kinds import FaultKind
from hil_bench.errors import ConfigError
from hil_bench.units import SECOND

LONGEST_RUN = 1e6  # [s]


def span(value: object) -> tuple[float, float]:
    """Return lowest and highest value.

    Raises:
        ConfigError: the value is something else.
    """
    if not isinstance(value, list) or len(value) != 2:
        raise ConfigError(f"{describe(value)} is not a range; give [lowest, highest]")
    low, high = (number()(bound) for bound in value)
    if low >= high:
        raise ConfigError(f"[{low:g}, {high:g}] is empty; give [lowest, highest]")
    return low, high


def values_by_name(value: object) -> Mapping[str, object]:
    """Return a table of one or more values.

    Raises:
        ConfigError: the value is something else.
    """
    if not isinstance(value, dict) or not value:
        right = 'write it as set = { "valve.spool_setpoint" = 0.4 }'
        raise ConfigError(f"{describe(value)} is not a table of values; {right}")
    return value


DURATION_KEY: Final = Key(
    "duration_s", number(SECOND, low=1e-3, high=LONGEST_RUN), None, SECOND, example="6.0"
)
HEAD_KEYS: Final = (
    Key("title", text, example='"Extends 100 mm"'),
    Key("bench", text),
    DURATION_KEY,
    Key("requirement_ids", texts, ()),
)
CONTROLLER_KEYS: Final = (Key("firmware", texts, ()), Key("example", text, ""))
PARAMETER_KEYS: Final = (Key("value", number(), example="100.0"), Key("range", span))
EXPECT_KEYS: Final = (
    Key("id", text, example='"SRS-41"'),
    Key("that", text, example='"always axis1.P_A < 250 bar"'),
)
AT_KEY: Final = Key("at_s", number(SECOND, low=0.0, high=LONGEST_RUN), None, SECOND, example="0.5")

_SET_KEYS: Final = (
    Key("set", values_by_name),
    Key("over_s", number(SECOND, low=0.0, high=LONGEST_RUN), 0.0, SECOND),
)
_TABLE_KEYS: Final = (Key("set", text), Key("table", text, example='"profile.csv"'))
_TARGET_KEY: Final = Key("target", text, example='"valve"')

STEP_KEYS: Final[Mapping[str, tuple[Key, ...]]] = MappingProxyType(
    {
        "set": (AT_KEY, *_SET_KEYS),
        "table": (AT_KEY, *_TABLE_KEYS),
        "nmt": (AT_KEY, Key("nmt", choice(NmtVerb)), _TARGET_KEY),
        "sync": (AT_KEY, Key("sync", boolean)),
        "firmware": (AT_KEY, Key("firmware", choice(Power)), Key("target", text, "")),
    }
)
"""The keys of each kind of step but a fault; the kind is one of its keys."""

STEP_KINDS: Final = ("set", "fault", "nmt", "sync", "firmware")


def fault_step_keys(kind: FaultKind) -> tuple[Key, ...]:
    """Return the keys of a step that is a fault."""
    common = {key.name: key for key in COMMON_KEYS}
    named = Key("fault", choice(FaultKind))
    return (AT_KEY, named, common["target"], common["for_s"], *OWN_KEYS[kind])
