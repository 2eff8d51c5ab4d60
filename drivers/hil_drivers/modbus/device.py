"""Common parts of the Modbus drivers: identity, polling, freshness of values."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from device_profiles import REGISTERS
from hil_drivers.errors import DeviceMismatchError, ModbusExceptionError, StaleValueError
from hil_drivers.modbus.client import ModbusClient
from hil_drivers.modbus.register_map import Register, RegisterMap

_SAMPLE = "sample"
_INPUTS = "input_registers"
_VENDOR_NAME, _PRODUCT_CODE = 0, 1
_NO_SUCH_FUNCTION = 1


class ModbusDevice:
    """Base of the Modbus drivers.

    Values may stand in the map in any type and scale.

    Args:
        client: the client that reaches the device.
        unit_id: its unit-ID.
        registers: its register map, or the file of it; None for the one of its profile.
        max_age: values older than this [s] are refused.

    Attributes:
        client: as passed in.
        unit_id: as passed in.
        map: its register map.
        max_age: as passed in; may be changed.

    Raises:
        ValueError: the unit-ID is out of range.
        RegisterMapError: the register map cannot be read.
        DeviceMismatchError: the map is for another kind of device, or lacks what the driver needs.
    """

    PROFILE: ClassVar[str]
    """Device profile that the register map must be for."""

    def __init__(
        self,
        client: ModbusClient,
        unit_id: int,
        registers: RegisterMap | Path | str | None = None,
        *,
        max_age: float = 0.1,
    ) -> None:
        if not 1 <= unit_id <= 247:
            raise ValueError(f"unit-ID {unit_id}: 1 to 247 is right")
        self.client = client
        self.unit_id = unit_id
        if not isinstance(registers, RegisterMap):
            registers = RegisterMap(registers or REGISTERS / f"{self.PROFILE}.toml")
        self.map = registers
        self.max_age = max_age
        if self.map.profile != self.PROFILE:
            raise DeviceMismatchError(
                f"{self.map.path} is for {self.map.profile}; a map for {self.PROFILE} is right"
            )
        self._sample_register = self.map.find(_INPUTS, _SAMPLE)
        self._poll_registers(self._find_registers())
        self._values: dict[Register, float] = {}
        self._sample: float | None = None
        self._received_at = -math.inf

    def __str__(self) -> str:
        return f"unit {self.unit_id} at {self.client.link.description}"

    @property
    def received_at(self) -> float:
        """When its values came, on the client's clock [s]; -inf before the first."""
        return self._received_at

    @property
    def age(self) -> float:
        """Time since its values came [s]; infinite before the first."""
        return self.client.now() - self._received_at

    def setup(self) -> None:
        """Check that the device is the one of the register map, and read its values."""
        self._check_identity()
        self.poll()

    def poll(self) -> bool:
        """Read the present values, and return True.

        A sample that was read before is no new value: it keeps the time at which it came first, so
        that a device that has stopped measuring is found out.
        """
        values: dict[Register, float] = {}
        for address, count in self._blocks:
            words = self.client.read_registers(self.unit_id, _INPUTS, address, count)
            for register in self._polled:
                start = register.address - address
                if 0 <= start < count:
                    values[register] = register.decode(words[start : start + register.count])
        sample = values.get(self._sample_register) if self._sample_register else None
        if sample is None or sample != self._sample:
            self._received_at = self.client.now()
        self._sample = sample
        self._values = values
        return True

    def _find_registers(self) -> Sequence[Register | None]:
        """Find what the driver needs in the map; return what is to be polled."""
        raise NotImplementedError

    def _poll_registers(self, registers: Sequence[Register | None]) -> None:
        """Have `poll` read these, and the number of the sample, by as few requests as it can."""
        wanted = {register for register in (*registers, self._sample_register) if register}
        self._polled = sorted(wanted, key=lambda register: register.address)
        self._blocks: list[tuple[int, int]] = []
        for register in self._polled:
            if self._blocks and sum(self._blocks[-1]) == register.address:
                address, count = self._blocks.pop()
                self._blocks.append((address, count + register.count))
            else:
                self._blocks.append((register.address, register.count))

    def _value(self, register: Register) -> float:
        """Return a value as it is counted.

        Raises:
            StaleValueError: it is too old, or was never read.
        """
        age = self.age
        if math.isinf(age):
            raise StaleValueError(f"{self}: {register.name} was never read; poll() reads it")
        if age > self.max_age:
            raise StaleValueError(
                f"{self}: {register.name} came {1000 * age:.1f} ms ago; "
                f"at most {1000 * self.max_age:g} ms are right"
            )
        return self._values[register]

    def _check_identity(self) -> None:
        """Compare the device identification with the register map.

        Raises:
            DeviceMismatchError: they differ.
            ModbusExceptionError: the device refused, other than for lack of that function.
        """
        try:
            found = self.client.read_identification(self.unit_id)
        except ModbusExceptionError as refusal:
            if refusal.code == _NO_SUCH_FUNCTION:
                return
            raise
        for number, name, expected in (
            (_VENDOR_NAME, "vendor name", self.map.vendor_name),
            (_PRODUCT_CODE, "product code", self.map.product_code),
        ):
            if found.get(number) != expected:
                raise DeviceMismatchError(
                    f'{self}: its {name} is "{found.get(number)}"; '
                    f'"{expected}" is right by {self.map.path}'
                )
