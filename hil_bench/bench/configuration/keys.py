"""The keys of `bench.toml` that belong to no kind: name, unit, default, and what each one fills.

`docs/configuration.md` tells the meaning of each.
"""

from functools import cache
from typing import Any, Final

from hil_bench.bench.configuration.records import FIRST_BUS
from hil_bench.config.objects import objects
from hil_bench.config.settings import CLOCK_MICROSECOND, Key
from hil_bench.config.values import (
    channel,
    choice,
    integer,
    interface,
    node_id,
    non_negative,
    nonzero,
    number,
    text,
    tpdo_numbers,
)
from hil_bench.kinds.generic import GENERIC
from hil_bench.kinds.kind import DeviceKind
from hil_bench.kinds.programs import program_memory
from hil_bench.kinds.registry import KINDS, kind_name
from hil_bench.outside.realtime.policy import OverrunPolicy, RealtimePolicy
from hil_bench.plants.hydraulic_cylinder.model.stepping import DEFAULT_STEP
from hil_bench.plants.registry import DEFAULT_PLANT

TABLES = ("bench", "bus", "buses", "supply", "plant", "nodes", "j1939", "faults")


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
