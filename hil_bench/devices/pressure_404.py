"""A transducer of one channel or several on the bus: profile CiA 404.

A channel is a sub-index of all its objects. The process value stands in four formats: REAL32
0x6130.01 in the unit of 0x6131.01, and the `integer_sets` 0x7130.01, 0x8130.01 and 0x9130.01, times
10^(0x6132.01). The unit is one of `UNITS`, of a temperature one of `TEMPERATURE_UNITS`; the
span 0x6148.01 to 0x6149.01 is the transducer's own and is shown in the same unit. What lies between
the measured quantity and the process value is the `analogue_input`; `value_interrupts` send it.

"zero", written to 0x6125.01, makes the process value 0 by the input offset 0x6124.01. "tare",
written to 0x6139.01, makes the net value 0x6140.01 zero by the tare 0x6138.01.

A quantity further outside the span than 3.125 % of it is an overload: the status 0x6150.01 has bit
0 (not valid) and bit 1 (positive) or bit 2 (negative), each format shows its mark for "no value"
(NaN, the lowest integer), and an EMCY 0xF001 goes out. When the quantity is back the values
return and the EMCY is taken back.

Sources: WIKA MH-4-CAN special documentation 14547342, object 6150h. Its text leaves open what a
value does that is valid but too large for a format: here that format alone shows its mark.
Axiomatic AX030301 manual, object 6125h (zero). HYDAC VFL protocol description (codes of degree
Celsius and Fahrenheit).
"""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Final, NamedTuple

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.datatypes import REAL32, UNSIGNED8, UNSIGNED32
from hil_bench.canopen_device.emcy import DEVICE_PROFILE
from hil_bench.canopen_device.events import NodeEventKind
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.devices.analogue_input import (
    LARGEST_REAL32,
    AnalogueInput,
    IntegerFaces,
    IntegerParameters,
    ValueInterrupts,
    check_real32,
    mapped_values,
)
from hil_bench.devices.bound_objects import TpdoTrigger, locate, optional, required
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

TEMPERATURE_UNITS: Final[Mapping[int, float]] = MappingProxyType(
    {0x002D0000: 1.0, 0x00AC0000: 5.0 / 9.0}
)
"""Temperature difference of one unit [K], by the unit's code: degree Celsius and Fahrenheit."""

_ZEROS: Final = MappingProxyType({0x00AC0000: -160.0 / 9.0})
"""What 0 of a unit is [°C], where it is not 0."""

OVERLOAD_MARGIN: Final = 0.03125
"""How far beyond the span a pressure is still measured, as a part of the span."""

OVERLOAD_EMCY: Final = 0xF001

_MOST_DIGITS: Final = 3
ZERO: Final = int.from_bytes(b"zero", "little")
TARE: Final = int.from_bytes(b"tare", "little")

NOT_VALID: Final = 0x01
POSITIVE_OVERLOAD: Final = 0x02
NEGATIVE_OVERLOAD: Final = 0x04


class Span(NamedTuple):
    """The measuring span of one channel.

    Attributes:
        start: of the measuring range [Pa or °C].
        end: of the measuring range [Pa or °C].
        units: the units that the channel knows, by their codes.
    """

    start: float
    end: float
    units: Mapping[int, float] = UNITS


class Channel:
    """One channel of a transducer.

    Attributes:
        node: the node that carries it on the bus.
    """

    def __init__(self, node: Node, span: Span, number: int) -> None:
        """Bind the profile's objects; EdsError where one is missing or of a wrong kind.

        Args:
            node: the node; its object dictionary comes from the transducer's EDS file.
            span: its measuring range.
            number: sub-index of its objects.

        Raises:
            ParameterError: `span` is no range.
        """
        start, end, self._units = span
        if not -math.inf < start < end < math.inf:
            raise ParameterError(
                f"span is {start!r} to {end!r} Pa; a measuring range ends above its start"
            )
        self.node = node
        self._number = number
        self._span = start, end
        margin = OVERLOAD_MARGIN * (end - start)
        self._lowest, self._highest = start - margin, end + margin
        od = node.object_dictionary
        self._bind_value(od)
        self._bind_scale(od)
        self._bind_commands(od)
        self._input = AnalogueInput(od, number)
        self._field_faces = IntegerFaces(od, 0x6100, number)
        trigger = TpdoTrigger(node, *mapped_values(number))
        self._interrupts = ValueInterrupts(od, trigger, number)
        self._parameters = IntegerParameters(od, number, self._digits)
        self._value = self._measured = 0.0
        self._scale()

    def _bind_value(self, od: ObjectDictionary) -> None:
        self._process_value = required(od, 0x6130, self._number, REAL32)
        self._faces = IntegerFaces(od, 0x6130, self._number)
        self._status = required(od, 0x6150, self._number, UNSIGNED8)
        self._net_value = optional(od, 0x6140, self._number, REAL32)

    def _bind_commands(self, od: ObjectDictionary) -> None:
        for index, signature, act in ((0x6125, ZERO, self._zero), (0x6139, TARE, self._tare_now)):
            command = optional(od, index, self._number, UNSIGNED32)
            command.add_check(partial(self._check_command, signature))
            command.add_hook(act)
        self._tare = optional(od, 0x6138, self._number, REAL32)
        self._tare.add_check(check_real32)
        self._tare.add_hook(self._show_again)

    def _bind_scale(self, od: ObjectDictionary) -> None:
        self._unit = required(od, 0x6131, self._number, UNSIGNED32)
        self._digits = optional(od, 0x6132, self._number, UNSIGNED8)
        self._span_start = optional(od, 0x6148, self._number, REAL32)
        self._span_end = optional(od, 0x6149, self._number, REAL32)
        if self._unit.default not in self._units:
            codes = ", ".join(f"0x{code:08X}" for code in self._units)
            raise EdsError(
                f"{locate(od, self._unit)} is 0x{self._unit.default:08X}; the units are {codes}"
            )
        self._unit.add_check(self._check_unit)
        self._unit.add_hook(self._change_unit)
        self._digits.add_check(_check_digits)
        self._digits.add_hook(self._scale)
        self._span_start.add_check(_refuse_span)
        self._span_end.add_check(_refuse_span)

    def publish(self, measured: float) -> None:
        """Put what is measured [Pa or °C] into the object dictionary."""
        if not self._lowest <= measured <= self._highest:
            self._show_overload(measured)
            return
        if self._status.value:
            self._end_overload()
        self._measured = measured
        self._show(self._measure())
        shown: float = self._process_value.value
        if not math.isnan(shown):
            self._interrupts.watch(self._value)

    def restart(self) -> None:
        """Begin anew with the objects' present values."""
        self._scale()
        self._input.restart()

    def _measure(self) -> float:
        """Return the process value of what is measured; shows the field value."""
        value = self._input.measure((self._measured - self._zero_point) / self._unit_size)
        field: float = self._input.field_value.value
        if abs(field) <= LARGEST_REAL32:
            self._field_faces.show(field, self._decimals)
        return value

    def _show(self, value: float) -> None:
        """Show a process value in all formats; each has a mark for what it cannot hold."""
        self._value = value
        if not -LARGEST_REAL32 <= value <= LARGEST_REAL32:  # nor is NaN
            self._show_no_value()
            return
        self._process_value.value = value
        tare: float = self._tare.value
        net = value - tare
        self._net_value.value = net if -LARGEST_REAL32 <= net <= LARGEST_REAL32 else math.nan
        self._faces.show(value, self._decimals)

    def _show_no_value(self) -> None:
        self._process_value.value = self._net_value.value = math.nan
        self._faces.show_none()

    def _show_overload(self, measured: float) -> None:
        self.node.emcy.raise_error(OVERLOAD_EMCY, DEVICE_PROFILE, source=self._number)
        self._status.value = NOT_VALID
        if measured > self._highest:
            self._status.value |= POSITIVE_OVERLOAD
        elif measured < self._lowest:
            self._status.value |= NEGATIVE_OVERLOAD
        self._show_no_value()
        self._input.restart()

    def _end_overload(self) -> None:
        self._status.value = 0
        self.node.emcy.clear_error(OVERLOAD_EMCY, self._number)

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
            self._show(self._measure())

    def _scale(self, _written: int = 0) -> None:
        self._unit_size = self._units[self._unit.value]
        self._zero_point = _ZEROS.get(self._unit.value, 0.0)
        self._decimals = 10**self._digits.value
        start, end = self._span
        self._span_start.value = (start - self._zero_point) / self._unit_size
        self._span_end.value = (end - self._zero_point) / self._unit_size
        self._parameters.show()

    def _check_unit(self, code: int) -> None:
        """Refuse a unit that the channel does not know.

        Raises:
            SdoAbort: 0609 0030.
        """
        if code not in self._units:
            raise SdoAbort(*abort_codes.VALUE)


class TransducerDevice:
    """The transducer behind one node.

    Attributes:
        node: the node that carries it on the bus.
        channels: in the order of their sub-indices, from 1.
    """

    def __init__(self, node: Node, spans: Sequence[Span]) -> None:
        """Bind the objects of each channel; `EdsError` and `ParameterError` as of `Channel`."""
        self.node = node
        self.channels = tuple(
            Channel(node, span, number) for number, span in enumerate(spans, start=1)
        )

    def publish(self, channel: int, measured: float) -> None:
        """Put what a channel measures into the object dictionary.

        Args:
            channel: its number, from 1.
            measured: pressure at the port [Pa], or temperature [°C].
        """
        if self.node.events:
            self._hear_events()
        self.channels[channel - 1].publish(measured)

    def _hear_events(self) -> None:
        while self.node.events:
            if self.node.events.popleft().kind is NodeEventKind.RESET_NODE:
                for channel in self.channels:
                    channel.restart()


class PressureDevice:
    """A transducer of one channel, for a pressure.

    Attributes:
        node: the node that carries it on the bus.
    """

    def __init__(self, node: Node, span: tuple[float, float]) -> None:
        """Bind the profile's objects; `EdsError` and `ParameterError` as of `Channel`.

        Args:
            node: the node; its object dictionary comes from the transducer's EDS file.
            span: pressures at the start and at the end of the measuring range [Pa].
        """
        self.node = node
        self._transducer = TransducerDevice(node, [Span(*span)])

    def publish(self, pressure: float, now: int) -> None:  # noqa: ARG002 - a sensor without delay
        """Put the measured pressure into the object dictionary.

        Args:
            pressure: pressure at the port [Pa].
            now: bench time [ns].
        """
        self._transducer.publish(1, pressure)


def _check_digits(digits: int) -> None:
    if digits > _MOST_DIGITS:
        raise SdoAbort(*abort_codes.VALUE_TOO_HIGH)


def _refuse_span(_value: float) -> None:
    raise SdoAbort(*abort_codes.READ_ONLY)
