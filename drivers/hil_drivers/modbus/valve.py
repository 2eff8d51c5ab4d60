"""Driver for a proportional valve with spool position feedback on Modbus."""

import contextlib
import struct
from collections.abc import Sequence

from hil_drivers.device import milliseconds
from hil_drivers.errors import DeviceFaultError
from hil_drivers.modbus.client import ModbusClient
from hil_drivers.modbus.device import ModbusDevice
from hil_drivers.modbus.register_map import Register
from hil_drivers.valve_control import ValveControl
from hil_drivers.valve_state import ValveState

_INPUTS, _HOLDING, _COILS = "input_registers", "holding_registers", "coils"


class ProportionalValve(ValveControl, ModbusDevice):
    """A proportional valve whose set-point comes by Modbus.

    `setup` takes control of the valve, `close` gives it back. A valve that was set up with a
    command time-out must be told its set-point again and again, by `spool_setpoint` or `send`; it
    has a fault otherwise, which is its protection against a controller that died.
    """

    PROFILE = "valve_408"
    RELEASED = "given back"

    def _find_registers(self) -> Sequence[Register | None]:
        self._status = self.map.require(_INPUTS, "0x6041")
        self._actual = self.map.require(_INPUTS, "spool_position")
        self._error = self.map.find(_INPUTS, "0x604E")
        self._setpoint = self.map.require(_HOLDING, "spool_setpoint")
        self._control_word = self.map.require(_HOLDING, "control_word")
        self._watchdog = self.map.require(_HOLDING, "watchdog")
        self._control = self.map.require(_COILS, "0x604F")
        return [self._actual, self._status, self._error]

    def setup(self, *, command_timeout: float = 0.1) -> None:
        """Check the device and take control of it.

        Args:
            command_timeout: the device's reaction comes when no command did for this time [s]; 0
                switches that off. A `ValueError` says that the device cannot watch such a time.
        """
        milliseconds("command time-out", command_timeout)
        watchdog = self._watchdog_words(command_timeout)
        super().setup()
        self.client.write_registers(self.unit_id, self._watchdog.address, watchdog)
        self._is_set_up = True
        self.client.write_coil(self.unit_id, self._control.address, on=True)
        self.poll()

    @property
    def spool_position(self) -> float:
        """Spool position as fraction of full opening [-], positive for P to A."""
        return self._value(self._actual) * self._actual.factor

    def send(self) -> None:
        """Send the set-point as it is, again."""
        self._write(self._setpoint, self._fraction)

    def _watchdog_words(self, timeout: float) -> list[int]:
        """Return the registers of a time-out [s].

        Raises:
            ValueError: they cannot hold it, or would hold 0, which switches the watchdog off.
        """
        register = self._watchdog
        with contextlib.suppress(struct.error):
            words = register.encode(timeout)
            if any(words) or not timeout:
                return words
        raise ValueError(
            f"command time-out {timeout} s: 0, or a time that {register.name} ({register.type}, "
            f"{register.factor:g} s a count) holds, is right"
        )

    @property
    def _medium(self) -> ModbusClient:
        return self.client

    def _status_word(self) -> int:
        return int(self._value(self._status))

    def _read_status_word(self) -> int:
        return self._read(self._status)

    def _send_command(self, control_word: int) -> None:
        # By one request where the map lets it.
        setpoint, word = self._setpoint, self._control_word
        if setpoint.address + setpoint.count == word.address:
            words = setpoint.encode(self._fraction) + word.encode(control_word)
            self.client.write_registers(self.unit_id, setpoint.address, words)
            return
        self._write(setpoint, self._fraction)
        self._write(word, control_word)

    def _has_error(self) -> bool:
        return self._read_error() != 0

    def _fault(self, state: ValveState) -> DeviceFaultError:
        code = self._read_error()
        if not code:
            return DeviceFaultError(f"{self}: valve in {state.name}, no error code", 0)
        return DeviceFaultError(f"{self}: valve in {state.name} after error 0x{code:04X}", code)

    def _release(self) -> None:
        self.client.write_coil(self.unit_id, self._control.address, on=False)

    def _read_error(self) -> int:
        """Return the emergency error code of the present fault; 0 for none or where unknown."""
        return 0 if self._error is None else self._read(self._error)

    def _read(self, register: Register) -> int:
        """Return the integer that an input register holds now."""
        words = self.client.read_registers(self.unit_id, _INPUTS, register.address, register.count)
        return int(register.decode(words))

    def _write(self, register: Register, value: float) -> None:
        self.client.write_registers(self.unit_id, register.address, register.encode(value))
