"""The kind `elf`: the program that is flashed, on a simulated chip."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hil_bench.abilities.controllers.elf.chips import CHIPS, find_chip
from hil_bench.abilities.controllers.elf.elf_file import read_program
from hil_bench.abilities.controllers.seam import Controller, ControllerKind, Surroundings
from hil_bench.config.settings import Key
from hil_bench.config.values import describe, integer, number, quote, text
from hil_bench.errors import ConfigError, ControllerError, require_extra
from hil_bench.units import Unit

_COPPER = 500_000  # bit/s, where the bus names none
_MHZ = Unit("MHz", "_mhz", 1e6)


def can_numbers(value: object) -> tuple[int, ...]:
    """Return the numbers of CAN controllers.

    Raises:
        ConfigError: the value is something else.
    """
    right = "write them as [1] or [2, 1], in the order of the buses"
    if not isinstance(value, list) or not value:
        raise ConfigError(f"{describe(value)} is no list of CAN controllers; {right}")
    if any(not isinstance(each, int) or isinstance(each, bool) or each < 1 for each in value):
        raise ConfigError(f"{value} is no list of CAN controllers; {right}")
    if len(set(value)) < len(value):
        raise ConfigError(f"{value} has one twice; {right}")
    return tuple(value)


class ElfKind(ControllerKind):
    """A program for a microcontroller."""

    name = "elf"
    summary = "the program that is flashed, on a simulated STM32"
    can_branch = True
    keys = (
        Key("program", text, example='"build/firmware.elf"'),
        Key("chip", text, example='"STM32F407"'),
        Key("can", can_numbers, ()),
        Key("crystal_mhz", number(_MHZ, low=1.0, high=50.0), 8.0, _MHZ),
        Key("instructions_per_ms", integer(1_000, 1_000_000), 20_000),
        Key("jitter_us", integer(0, 10_000), 0),
    )

    def problems(self, settings: Mapping[str, Any], folder: Path) -> Sequence[str]:
        """Return the faults of the chip; the program may be built between the check and the run."""
        del folder
        chip = find_chip(settings["chip"])
        if chip is None:
            known = ", ".join(CHIPS)
            return [f"chip: {quote(settings['chip'])} is not known; known are {known}"]
        count = len(chip.family.can)
        if any(each > count for each in settings["can"]):
            return [f"can: {chip.name} has CAN controllers 1 to {count}"]
        return ()

    def build(self, settings: Mapping[str, Any], surroundings: Surroundings) -> Controller:
        """Start the simulator.

        Raises:
            ConfigError: unicorn is missing, or the program is none for this chip.
            ControllerError: the program's bus is not there.
        """
        require_extra("unicorn", f'{surroundings.place}: kind = "elf"', "elf")
        from hil_bench.abilities.controllers.elf.controller import (  # noqa: PLC0415 - seldom
            ElfController,
        )
        from hil_bench.abilities.controllers.elf.job import Job  # noqa: PLC0415 - likewise

        chip = find_chip(settings["chip"])
        if chip is None:
            raise ControllerError(f"{settings['chip']}: no such chip")
        path = surroundings.folder / surroundings.filled(settings["program"])
        read_program(path)
        can = settings["can"] or tuple(range(1, len(surroundings.buses) + 1))
        count = len(chip.family.can)
        if len(can) != len(surroundings.buses) or max(can) > count:
            wrong = f"{len(surroundings.buses)} buses for {len(can)} of {count} CAN controllers"
            right = "name its buses, and one controller for each in can"
            raise ConfigError(f"{surroundings.place}: {wrong} of {chip.name}; {right}")
        buses = [surroundings.config.buses[name] for name in surroundings.buses]
        bits = [10**9 // (bus.bitrate or _COPPER) if bus.wire else 0 for bus in buses]
        job = Job(
            path,
            chip.name,
            settings["instructions_per_ms"],
            round(settings["crystal_mhz"]),
            can,
            tuple(bits),
            settings["jitter_us"] * 1000,
            f"{surroundings.config.seed} {surroundings.name}",
        )
        return ElfController(job, surroundings.tick_ns)


KIND = ElfKind()
