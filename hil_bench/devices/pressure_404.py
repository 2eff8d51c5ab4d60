"""A pressure transducer with one channel on the bus: profile CiA 404.

The process value stands in three formats: REAL32 0x6130.01 in the unit of 0x6131.01, and INTEGER16
0x7130.01 and INTEGER32 0x9130.01, both times 10^(0x6132.01). The unit is one of `UNITS`; the
span 0x6148.01 to 0x6149.01 is the transducer's own and is shown in the same unit. What lies between
the measured pressure and the process value is the `analogue_input`; `value_interrupts` send it.

"zero", written to 0x6125.01, makes the process value 0 by the input offset 0x6124.01. "tare",
written to 0x6139.01, makes the net value 0x6140.01 zero by the tare 0x6138.01.

A pressure further outside the span than 3.125 % of it is an overload: the status 0x6150.01 has bit
0 (not valid) and bit 1 (positive) or bit 2 (negative), each format shows its mark for "no value"
(NaN, -32768, -2147483648), and an EMCY 0xF001 goes out. When the pressure is back the values
return and the EMCY is taken back.

Sources: WIKA MH-4-CAN special documentation 14547342, object 6150h. Its text leaves open what a
value does that is valid but too large for a format: here that format alone shows its mark.
Axiomatic AX030301 manual, object 6125h (zero).
"""

import math
from collections.abc import Mapping
from functools import partial
from types import MappingProxyType
from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.datatypes import (
    INTEGER16,
    INTEGER32,
    REAL32,
    UNSIGNED8,
    UNSIGNED32,
)
from hil_bench.canopen_device.emcy import DEVICE_PROFILE
from hil_bench.canopen_device.events import NodeEventKind
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.devices.analogue_input import LARGEST_REAL32, AnalogueInput, check_real32
from hil_bench.devices.profile_objects import TpdoTrigger, locate, optional, required
from hil_bench.devices.value_interrupts import ValueInterrupts
from hil_bench.errors import EdsError, ParameterError, SdoAbort

UNITS: Final[Mapping[int, float]] = MappingProxyType(
    {
        0x004E0000: 1e5,  # bar
        0xFD4E0000: 1e2,  # mbar
        0x00220000: 1.0,  # Pa
        0x02220000: 1e2,  # hPa
        0x03220000: 1e3,  # kPa
        0x06220000: 1e6,  # MPa
        0x00AB0000: 0.45359237 * 9.80665 / 0.0254**2,  # psi: pound-force a square inch
    }
)
"""Pressure of one unit [Pa], by the unit's code in 0x6131.

The highest byte is the power of ten as a signed number, the next one the unit: 0x22 pascal, 0x4E
bar (CiA 303-2), 0xAB psi.
"""

OVERLOAD_MARGIN: Final = 0.03125
"""How far beyond the span a pressure is still measured, as a part of the span."""

OVERLOAD_EMCY: Final = 0xF001

_MOST_DIGITS: Final = 3
ZERO: Final = int.from_bytes(b"zero", "little")
TARE: Final = int.from_bytes(b"tare", "little")

NOT_VALID: Final = 0x01
POSITIVE_OVERLOAD: Final = 0x02
NEGATIVE_OVERLOAD: Final = 0x04


class PressureDevice:
    """The transducer behind one node.

    Attributes:
        node: the node that carries it on the bus.
    """

    def __init__(self, node: Node, span: tuple[float, float]) -> None:
        """Bind the profile's objects; EdsError where one is missing or of a wrong kind.

        Args:
            node: the node; its object dictionary comes from the transducer's EDS file.
            span: pressures at the start and at the end of the measuring range [Pa].

        Raises:
            ParameterError: `span` is no range of pressures.
        """
        start, end = span
        if not -math.inf < start < end < math.inf:
            raise ParameterError(
                f"span is {start!r} to {end!r} Pa; a measuring range ends above its start"
            )
        self.node = node
        self._span = span
        margin = OVERLOAD_MARGIN * (end - start)
        self._lowest, self._highest = start - margin, end + margin
        od = node.object_dictionary
        self._bind_value(od)
        self._bind_scale(od)
        self._bind_commands(od)
        self._input = AnalogueInput(od)
        formats = ((0x6130, 1), (0x7130, 1), (0x9130, 1), (0x6140, 1))
        self._interrupts = ValueInterrupts(od, TpdoTrigger(node, *formats))
        self._value = self._pressure = 0.0
        self._scale()

    def _bind_value(self, od: ObjectDictionary) -> None:
        self._process_value = required(od, 0x6130, 1, REAL32)
        self._int16 = optional(od, 0x7130, 1, INTEGER16)
        self._int32 = optional(od, 0x9130, 1, INTEGER32)
        self._status = required(od, 0x6150, 1, UNSIGNED8)
        self._net_value = optional(od, 0x6140, 1, REAL32)

    def _bind_commands(self, od: ObjectDictionary) -> None:
        for index, signature, act in ((0x6125, ZERO, self._zero), (0x6139, TARE, self._tare_now)):
            command = optional(od, index, 1, UNSIGNED32)
            command.add_check(partial(self._check_command, signature))
            command.add_hook(act)
        self._tare = optional(od, 0x6138, 1, REAL32)
        self._tare.add_check(check_real32)
        self._tare.add_hook(self._show_again)

    def _bind_scale(self, od: ObjectDictionary) -> None:
        self._unit = required(od, 0x6131, 1, UNSIGNED32)
        self._digits = optional(od, 0x6132, 1, UNSIGNED8)
        self._span_start = optional(od, 0x6148, 1, REAL32)
        self._span_end = optional(od, 0x6149, 1, REAL32)
        if self._unit.default not in UNITS:
            raise EdsError(
                f"{locate(od, self._unit)} is 0x{self._unit.default:08X}; "
                f"the units are {_unit_codes()}"
            )
        self._unit.add_check(_check_unit)
        self._unit.add_hook(self._change_unit)
        self._digits.add_check(_check_digits)
        self._digits.add_hook(self._scale)
        self._span_start.add_check(_refuse_span)
        self._span_end.add_check(_refuse_span)

    def publish(self, pressure: float, now: int) -> None:  # noqa: ARG002 - a sensor without delay
        """Put the measured pressure into the object dictionary.

        Args:
            pressure: pressure at the port [Pa].
            now: bench time [ns].
        """
        if self.node.events:
            self._hear_events()
        if not self._lowest <= pressure <= self._highest:
            self._show_overload(pressure)
            return
        if self._status.value:
            self._end_overload()
        self._pressure = pressure
        self._show(self._input.measure(pressure / self._unit_pressure))
        if not math.isnan(self._process_value.value):
            self._interrupts.watch(self._value)

    def _show(self, value: float) -> None:
        """Show a process value in all formats; each has a mark for what it cannot hold."""
        self._value = value
        if not abs(value) <= LARGEST_REAL32:  # nor is NaN
            self._show_no_value()
            return
        self._process_value.value = value
        net = value - self._tare.value
        self._net_value.value = net if abs(net) <= LARGEST_REAL32 else math.nan
        scaled = round(value * self._decimals)
        self._int16.value = scaled if -32768 <= scaled <= 32767 else -32768
        self._int32.value = scaled if -2147483648 <= scaled <= 2147483647 else -2147483648

    def _show_no_value(self) -> None:
        self._process_value.value = self._net_value.value = math.nan
        self._int16.value = -32768
        self._int32.value = -2147483648

    def _show_overload(self, pressure: float) -> None:
        self.node.emcy.raise_error(OVERLOAD_EMCY, DEVICE_PROFILE)
        self._status.value = NOT_VALID
        if pressure > self._highest:
            self._status.value |= POSITIVE_OVERLOAD
        elif pressure < self._lowest:
            self._status.value |= NEGATIVE_OVERLOAD
        self._show_no_value()
        self._input.restart()

    def _end_overload(self) -> None:
        self._status.value = 0
        self.node.emcy.clear_error(OVERLOAD_EMCY)

    def _hear_events(self) -> None:
        while self.node.events:
            if self.node.events.popleft().kind is NodeEventKind.RESET_NODE:
                self._scale()
                self._input.restart()

    def _check_command(self, expected: int, signature: int) -> None:
        """Refuse a wrong signature, and what cannot be done now.

        Raises:
            SdoAbort: 0800 0020 the signature, 0800 0022 there is no value.
        """
        if signature != expected:
            raise SdoAbort(*abort_codes.NOT_STORED)
        if math.isnan(self._process_value.value):
            raise SdoAbort(*abort_codes.DEVICE_STATE)

    def _zero(self, _signature: int) -> None:
        # Through the object, so that an offset that REAL32 cannot hold is refused.
        self._input.input_offset.write(self._input.input_offset.value - self._value)
        self._show(0.0)

    def _tare_now(self, _signature: int) -> None:
        self._tare.value = self._value
        self._show(self._value)

    def _show_again(self, _written: float) -> None:
        if not self._status.value:
            self._show(self._value)

    def _change_unit(self, _written: int) -> None:
        self._scale()
        self._input.restart()
        if not self._status.value:
            self._show(self._input.measure(self._pressure / self._unit_pressure))

    def _scale(self, _written: int = 0) -> None:
        self._unit_pressure = UNITS[self._unit.value]
        self._decimals = 10**self._digits.value
        start, end = self._span
        self._span_start.value = start / self._unit_pressure
        self._span_end.value = end / self._unit_pressure


def _check_unit(code: int) -> None:
    if code not in UNITS:
        raise SdoAbort(*abort_codes.VALUE)


def _check_digits(digits: int) -> None:
    if digits > _MOST_DIGITS:
        raise SdoAbort(*abort_codes.VALUE_TOO_HIGH)


def _refuse_span(_value: float) -> None:
    raise SdoAbort(*abort_codes.READ_ONLY)


def _unit_codes() -> str:
    return ", ".join(f"0x{code:08X}" for code in UNITS)
