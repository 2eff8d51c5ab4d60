"""Modbus registers by the names that scenarios give them: "modbus.valve.spool_setpoint"."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from hil_bench.abilities.modbus.binding import BoundUnit, ModbusBinding
from hil_bench.abilities.modbus.protocol.exceptions import ModbusException
from hil_bench.abilities.modbus.protocol.exchange import BoundRegister
from hil_bench.abilities.modbus.protocol.register_map import RegisterAccess
from hil_bench.errors import ConfigError, SdoAbort
from hil_bench.session.commands import Controls
from hil_bench.units import ONE

MODBUS = "modbus"
"""What the names of registers begin with."""


class RegisterTarget(NamedTuple):
    """A register of a Modbus unit.

    Attributes:
        name: in scenarios.
        unit: the unit, with all its registers.
        entry: the register, and what stands behind it.
    """

    name: str
    unit: BoundUnit
    entry: BoundRegister

    def read(self) -> float:
        """Return the SI value that a client reads; NaN where there is none."""
        return self.entry.register.as_read(self.entry.read())

    @property
    def is_writable(self) -> bool:
        """Return True if clients may write it."""
        return self.unit.may_write(self.entry.register)

    def check_writable(self) -> None:
        """Refuse a register that clients may not write.

        Raises:
            ConfigError: they may not; it says why.
        """
        if self.is_writable:
            return
        if self.entry.register.access is RegisterAccess.COMMAND:
            right = f"give commands = true in [modbus.units.{self.unit.name}]"
            raise ConfigError(f"{self.name} is a command, which Modbus may not give; {right}")
        raise ConfigError(f"{self.name} is read-only; hil-bench registers says which are not")

    def check_value(self, value: float) -> None:
        """Refuse a value [SI] that the register cannot take.

        Raises:
            ConfigError: it is out of range.
        """
        unit, (low, high) = self.entry.register.unit, self.entry.register.limits
        given = unit.from_si(value)
        if not low <= given <= high:
            symbol = "" if unit is ONE else f" {unit.symbol}"
            right = f"give {low:g} to {high:g}{symbol}"
            raise ConfigError(f"{self.name}: {given:g}{symbol} is out of range; {right}")


@dataclass(frozen=True, slots=True)
class WriteRegister:
    """Write a register as a Modbus client does; a command to the door of a session.

    Attributes:
        target: the register.
        value: in SI.
    """

    target: RegisterTarget
    value: float

    def act(self, controls: Controls, now: int) -> None:  # noqa: ARG002 - Command's
        """Write it in this tick.

        Raises:
            ConfigError: the unit or its device refuses it.
        """
        target = self.target
        try:
            target.unit.write(target.entry.register, self.value, now)
        except (ModbusException, SdoAbort) as error:
            shown = target.entry.register.unit.from_si(self.value)
            raise ConfigError(f"{target.unit.name} refuses {shown:g}: {error}") from None


def name_registers(modbus: ModbusBinding | None) -> dict[str, RegisterTarget]:
    """Return the registers of all units by name; none without Modbus.

    A name that stands in several tables of its unit has the table before it:
    "modbus.valve.coils.control".
    """
    return dict(_named(modbus)) if modbus is not None else {}


def name_shared(registers: Mapping[str, RegisterTarget]) -> dict[str, str]:
    """Return the right names for each name that several tables of a unit share."""
    found: dict[str, list[str]] = {}
    for name, target in registers.items():
        short = f"{MODBUS}.{target.unit.name}.{target.entry.register.name}"
        found.setdefault(short, []).append(name)
    return {short: " or ".join(names) for short, names in found.items() if len(names) > 1}


def _named(modbus: ModbusBinding) -> Iterator[tuple[str, RegisterTarget]]:
    for unit in modbus.units:
        counts = Counter(entry.register.name for entry in unit.entries)
        for entry in unit.entries:
            register = entry.register
            is_alone = counts[register.name] == 1
            rest = register.name if is_alone else f"{register.table}.{register.name}"
            name = f"{MODBUS}.{unit.name}.{rest}"
            yield name, RegisterTarget(name, unit, entry)
