"""A device's registers as its register map tells them: what the EDS file is to CANopen.

The file is that of the bench and of `docs/modbus.md`; only what a driver needs of it is read.
"""

import math
import struct
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hil_drivers.errors import DeviceMismatchError, RegisterMapError

_LETTERS = {"int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f"}
_FINEST_FIRST = ("float32", "int32", "uint32", "int16", "uint16", "bit")
_FACTORS = (
    {"-": 1.0, "%": 0.01}
    | {"Pa": 1.0, "mbar": 1e2, "kPa": 1e3, "bar": 1e5, "MPa": 1e6}
    | {"m": 1.0, "mm": 1e-3, "um": 1e-6, "m/s": 1.0, "mm/s": 1e-3}
    | {"rad": 1.0, "deg": math.pi / 180.0, "rev": math.tau}
    | {"rad/s": 1.0, "deg/s": math.pi / 180.0, "rpm": math.tau / 60.0}
    | {"s": 1.0, "ms": 1e-3, "us": 1e-6}
)
_TABLES = ("coils", "discrete_inputs", "input_registers", "holding_registers")


@dataclass(frozen=True, slots=True)
class Register:
    """One value.

    Attributes:
        name: as in the map.
        table: where it stands.
        address: of its first register, from 0.
        type: as in the map; ``bit`` in the tables of bits.
        factor: SI value of one count.
        is_little: whether the low word comes first.
    """

    name: str
    table: str
    address: int
    type: str
    factor: float
    is_little: bool

    @property
    def count(self) -> int:
        """Registers that it takes."""
        return 2 if self.type.endswith("32") else 1

    @property
    def no_value(self) -> float | None:
        """The number that stands for an invalid value in an integer type; None for other types."""
        return {"int16": -(2.0**15), "int32": -(2.0**31)}.get(self.type)

    def decode(self, words: Sequence[int]) -> float:
        """Return the value as it is counted; `factor` makes it SI."""
        ordered = words[::-1] if self.is_little else words
        raw = struct.pack(f">{self.count}H", *ordered)
        return float(struct.unpack(f">{_LETTERS[self.type]}", raw)[0])

    def encode(self, value: float) -> list[int]:
        """Return the registers of an SI value; `struct.error` where it does not fit."""
        counts = value / self.factor
        raw = struct.pack(
            f">{_LETTERS[self.type]}", counts if self.type == "float32" else round(counts)
        )
        words = list(struct.unpack(f">{self.count}H", raw))
        return words[::-1] if self.is_little else words


class RegisterMap:
    """The registers of one device, by what they are of.

    Args:
        path: the file.
        word_order: ``big`` or ``little``, in the place of the file's, where a register has none.

    Attributes:
        path: as passed in.
        profile: the device profile that it is for.
        vendor_name: as the device identification should say.
        product_code: likewise.

    Raises:
        RegisterMapError: the file cannot be read, or is no register map.
    """

    def __init__(self, path: Path | str, *, word_order: str | None = None) -> None:
        self.path = Path(path)
        try:
            document = tomllib.loads(self.path.read_text(encoding="utf-8"))
            device = document["device"]
            self.profile: str = device["profile"]
            self.vendor_name: str = device["vendor_name"]
            self.product_code: str = device["product_code"]
            order = word_order or device.get("word_order", "big")
            self._registers = {
                (table, entry["source"], entry.get("type", "bit")): _register(
                    table, name, entry, order
                )
                for table in _TABLES
                for name, entry in document.get(table, {}).items()
            }
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            what = f"{type(error).__name__}: {error}"
            raise RegisterMapError(f"{self.path}: is not a register map: {what}") from None

    def find(self, table: str, source: str) -> Register | None:
        """Return the register of a quantity or an object, in its finest type; None for none."""
        for kind in _FINEST_FIRST:
            register = self._registers.get((table, source, kind))
            if register is not None:
                return register
        return None

    def require(self, table: str, source: str) -> Register:
        """Return the register of a quantity or an object, in its finest type.

        Raises:
            DeviceMismatchError: the map has none.
        """
        register = self.find(table, source)
        if register is None:
            raise DeviceMismatchError(
                f'{self.path}: no register in {table} has source "{source}"; '
                "a map that has one is right"
            )
        return register


def _register(table: str, name: str, entry: dict[str, Any], order: str) -> Register:
    kind = entry.get("type", "bit")
    if kind not in _FINEST_FIRST:
        raise ValueError(f"{table}.{name}: type {kind!r}")
    return Register(
        name=name,
        table=table,
        address=int(entry["address"]),
        type=kind,
        factor=_FACTORS[entry.get("unit", "-")] * entry.get("scale", 1.0),
        is_little=entry.get("word_order", order) == "little",
    )
