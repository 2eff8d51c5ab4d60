"""The table ``[bench]``: ticks, steps and seed, and what makes the ticks."""

import os
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any, Final

from hil_bench.ability import given_to
from hil_bench.bench.configuration.records import FIRST_BUS
from hil_bench.canopen_device.nmt import UNCONFIGURED
from hil_bench.config.document import Document, read_section
from hil_bench.config.objects import objects
from hil_bench.config.settings import (
    CLOCK_MICROSECOND,
    Given,
    Key,
    Origin,
    Problems,
    Settings,
    convert,
    read_table,
)
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
from hil_bench.devices.kinds.kind import GENERIC, DeviceKind
from hil_bench.devices.kinds.registry import KINDS, kind_name
from hil_bench.errors import ConfigError
from hil_bench.outside.realtime.clock import OverrunPolicy, RealtimeConfig, RealtimePolicy
from hil_bench.plants.hydraulic_cylinder.model.stepping import DEFAULT_STEP
from hil_bench.plants.registry import DEFAULT_PLANT

# The keys of `bench.toml` that belong to no kind: name, unit, default, and what each one fills.
#
# `docs/configuration.md` tells the meaning of each.


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
def added_keys() -> tuple[Key, ...]:
    """Return the keys of the table of each node that abilities have."""
    return tuple(key for module in given_to("nodes") for key in module.KEYS)


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
        *added_keys(),
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


SEED_VARIABLE = "HIL_BENCH_SEED"


class LoopSection:
    """The settings of ``[bench]``, the environment and the command line.

    Args:
        document: the file.
        overrides: keys of the command line; None for what it does not say.
        problems: where problems are noted.

    Attributes:
        settings: the table.
    """

    def __init__(
        self, document: Document, overrides: Mapping[str, object], problems: Problems
    ) -> None:
        given = read_section(document, "bench", problems)
        if text := os.environ.get(SEED_VARIABLE):
            value = int(text) if text.isascii() and text.isdecimal() else text
            given["seed"] = Given(value, Origin.ENVIRONMENT, f"environment:{SEED_VARIABLE}")
        for key, override in overrides.items():
            if override is not None:
                given[key] = Given(override, Origin.COMMAND_LINE, f"--{key.replace('_', '-')}")
        self.settings = read_table("bench", given, BENCH_KEYS, problems)
        self._problems = problems

    @property
    def step_us(self) -> int:
        """Step of the plants' solvers [us]."""
        step: int = self.settings["step_us"].value
        return step

    @property
    def steps_per_tick(self) -> int:
        """Plant steps in one tick."""
        tick_us: int = self.settings["tick_us"].value
        return max(tick_us // self.step_us, 1)

    def resolve(self) -> None:
        """Note ticks that are no multiples of steps, and a processor that no policy can have."""
        bench, problems = self.settings, self._problems
        if bench["sync_period_us"].value is None:
            bench["sync_period_us"] = bench["sync_period_us"]._replace(value=bench["tick_us"].value)
        for key, divisor in (("tick_us", "step_us"), ("sync_period_us", "tick_us")):
            if wrong := _no_multiple(bench[key].value, divisor, bench[divisor].value):
                is_option = bench[key].origin is Origin.COMMAND_LINE
                place = f"--{key.replace('_', '-')}" if is_option else problems.place("bench", key)
                problems.add(place, wrong)
        policy, cpu = bench["realtime"].value, bench["realtime_cpu"].value
        if policy is RealtimePolicy.DEADLINE and cpu is not None:
            wrong = f'{cpu} with realtime = "deadline", which Linux ties to no processor'
            right = 'leave realtime_cpu out, or give realtime = "fifo"'
            problems.add(problems.place("bench", "realtime_cpu"), f"{wrong}; {right}")
        if wrong := _no_spin(bench):
            problems.add(problems.place("bench", "realtime_spin_us"), wrong)

    def build(self) -> dict[str, Any]:
        """Return ticks and seed, and the real-time policy."""
        policy = RealtimeConfig(**convert(self.settings, REALTIME_KEYS))
        return {**convert(self.settings, LOOP_KEYS), "realtime": policy}

    def tables(self) -> Iterable[Settings]:
        """Return the table."""
        return (self.settings,)


def _no_spin(bench: Settings) -> str:
    """Return the error text of a busy wait that no processor can be given; empty for others."""
    spin, tick = bench["realtime_spin_us"].value, bench["tick_us"].value
    if not spin:
        return ""
    if bench["realtime"].value is not RealtimePolicy.FIFO or bench["realtime_cpu"].value is None:
        return f'{spin} needs a processor of its own; give realtime = "fifo" and realtime_cpu'
    if 2 * spin > tick:
        return f"{spin} is more than half of tick_us = {tick}; give at most {tick // 2}"
    return ""


def _no_multiple(value: int, divisor: str, step: int) -> str:
    """Return the error text of a value that is no multiple of a step; empty where it is one."""
    if not value % step:
        return ""
    below, above = value // step * step, (value // step + 1) * step
    right = f"give {below} or {above}" if below else f"give {above}"
    return f"{value} is not a multiple of {divisor} = {step}; {right}"
