"""The keys of `bench.toml` that belong to no kind: name, unit, default, and what each one fills.

`docs/configuration.md` tells the meaning of each.
"""

from functools import cache
from typing import Any, Final

from hil_bench.bench.configuration.records import FIRST_BUS
from hil_bench.canopen_device.nmt import UNCONFIGURED
from hil_bench.config.objects import objects
from hil_bench.config.settings import CLOCK_MICROSECOND, Key
from hil_bench.config.values import (
    boolean,
    choice,
    describe,
    find_nearest,
    integer,
    non_negative,
    nonzero,
    number,
    text,
)
from hil_bench.errors import ConfigError
from hil_bench.kinds.generic import GENERIC
from hil_bench.kinds.kind import DeviceKind
from hil_bench.kinds.programs import program_memory
from hil_bench.kinds.registry import KINDS, kind_name
from hil_bench.outside.realtime.policy import OverrunPolicy, RealtimePolicy
from hil_bench.plants.hydraulic_cylinder.model.stepping import DEFAULT_STEP
from hil_bench.plants.registry import DEFAULT_PLANT

_HIGHEST_NODE_ID = 127
_INTERFACES = {"socketcan", "socketcand", "virtual"}  # every python-can has them

TABLES = ("bench", "bus", "buses", "supply", "plant", "nodes")


def interface(value: object) -> str:
    """Return the name of an interface that python-can has.

    Raises:
        ConfigError: it has none of this name.
    """
    name = text(value)
    if name in _INTERFACES:
        return name
    from can import VALID_INTERFACES  # noqa: PLC0415 - takes longer than all of `hil-bench check`

    if name not in VALID_INTERFACES:
        nearest = find_nearest(name, VALID_INTERFACES)
        raise ConfigError(
            f'python-can has no interface {describe(name)}; the nearest is "{nearest}"'
        )
    return name


def channel(value: object) -> str | int:
    """Return a channel, which some interfaces name and others number.

    Raises:
        ConfigError: the value is something else.
    """
    if isinstance(value, int) and not isinstance(value, bool):
        return value
    if not isinstance(value, str) or not value:
        raise ConfigError(
            f'{describe(value)} is not a channel; give text or a number, as in "can0"'
        )
    return value


def node_id(value: object) -> int:
    """Return a CANopen node-ID, 255 for a node that has none yet.

    Raises:
        ConfigError: the value is something else.
    """
    right = f'give an integer from 1 to {_HIGHEST_NODE_ID}, or "unconfigured"'
    if value in (UNCONFIGURED, "unconfigured"):
        return UNCONFIGURED
    if not isinstance(value, int) or isinstance(value, bool):
        raise ConfigError(f"{describe(value)} is not a node-ID; {right}")
    if not 1 <= value <= _HIGHEST_NODE_ID:
        raise ConfigError(f"{describe(value)} is out of range; {right}")
    return value


def tpdo_numbers(value: object) -> tuple[int, ...]:
    """Return numbers of TPDOs, none of them twice.

    Raises:
        ConfigError: it is no such list.
    """
    right = "give a list of numbers of TPDOs, such as [1, 2]"
    if not isinstance(value, list | tuple):
        raise ConfigError(f"{describe(value)} is not a list; {right}")
    read = integer(1, 512)
    numbers = tuple(int(read(number)) for number in value)
    if len(set(numbers)) < len(numbers):
        raise ConfigError(f"{list(numbers)} has a number twice; {right}")
    return numbers


REALTIME_KEYS = (
    Key("realtime", choice(RealtimePolicy), RealtimePolicy.OFF, field="policy"),
    Key("realtime_priority", integer(1, 98), 80, field="priority"),
    Key("realtime_cpu", integer(0, 4095), field="cpu"),
    Key("realtime_spin_us", integer(0, 500_000), 0, CLOCK_MICROSECOND, "spin"),
    Key("overrun", choice(OverrunPolicy), OverrunPolicy.COUNT),
)

LOOP_KEYS = (
    Key("tick_us", integer(100, 1_000_000), 1000, CLOCK_MICROSECOND, "tick_ns"),
    Key("step_us", integer(1, 10_000), round(1e6 * DEFAULT_STEP), CLOCK_MICROSECOND, "step_ns"),
    Key("sync_period_us", integer(100, 60_000_000), None, CLOCK_MICROSECOND, "sync_period_ns"),
    Key("seed", integer(0), 1),
)

BENCH_KEYS = (*LOOP_KEYS, *REALTIME_KEYS)

BUS_KEYS = (
    Key("interface", interface),
    Key("channel", channel),
    Key("bitrate", integer(1, 1_000_000)),
    Key("fd", boolean, default=False),
    Key("data_bitrate", integer(1, 12_000_000)),
)

_FIRST_KIND = next(iter(KINDS.built_in))

PROFILE_KEY: Final = Key(
    "profile",
    kind_name,
    example=f'"{_FIRST_KIND}", or eds = "vendor.eds" for a device made from that file alone',
)


@cache
def node_keys(kind: DeviceKind[Any]) -> tuple[Key, ...]:
    """Return the keys of the table of a node of a kind, but for its chain."""
    return (
        PROFILE_KEY if kind is not GENERIC else Key("profile", kind_name, GENERIC.name),
        Key("node_id", node_id, example="1"),
        Key("bus", text, FIRST_BUS),
        *((Key("axis", text),) if kind.has_axis else ()),
        Key("eds", text, example="" if kind.eds else '"vendor.eds"'),
        Key("storage", text),
        Key("serial_number", integer(0, 0xFFFFFFFF)),
        Key("objects", objects),
        Key("protected_tpdos", tpdo_numbers, ()),
        Key("program", program_memory),
        *kind.keys,
    )


_SCALE_KEYS = (
    Key("unit", text),
    Key("scale", nonzero, 1.0),
    Key("offset", number(), 0.0),
)

SOURCE_KEYS = (
    Key("source", text, example=f'"axis1.{DEFAULT_PLANT.outputs_in("Pa")[0].name}"'),
    *_SCALE_KEYS,
    Key("delta", non_negative),
)

SINK_KEYS = (
    Key("sink", text, example=f'"axis1.{DEFAULT_PLANT.command.name}"'),
    *_SCALE_KEYS,
    Key("safe", number(), 0.0),
)
