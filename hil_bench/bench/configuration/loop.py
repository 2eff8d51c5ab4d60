"""The table ``[bench]``: ticks, steps and seed, and what makes the ticks."""

import os
from collections.abc import Iterable, Mapping
from typing import Any

from hil_bench.bench.configuration.keys import BENCH_KEYS, LOOP_KEYS, REALTIME_KEYS
from hil_bench.config.document import Document, read_section
from hil_bench.config.settings import Given, Origin, Problems, Settings, convert, read_table
from hil_bench.outside.realtime.policy import RealtimeConfig, RealtimePolicy

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
