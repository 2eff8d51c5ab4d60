"""Quantities of our kinds of devices for Modbus, to read and write, by name, in SI.

They are computed from the device's objects as they stand, so that two buses never tell two values:
what CANopen sends as steps or in bar, is metres, radians and pascal here. Any object can be had
too, as its own number.
"""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final, cast

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.devices.axis import Fitting, RegisterValue
from hil_bench.devices.encoder_406 import POSITION_UNITS, SPEED_UNITS
from hil_bench.devices.kinds.encoder_406 import EncoderKind, RedundantEncoderKind, RotaryEncoderKind
from hil_bench.devices.kinds.kind import DeviceKind
from hil_bench.devices.kinds.pressure_404 import PressureKind, TransducerKind
from hil_bench.devices.kinds.valve_408 import ValveKind
from hil_bench.devices.pressure_404 import (
    NEGATIVE_OVERLOAD,
    NOT_VALID,
    POSITIVE_OVERLOAD,
    UNITS,
    ZERO,
)
from hil_bench.devices.rotary_encoder_406 import SCALING_BIT
from hil_bench.devices.valve_408 import REFERENCE, ValveDevice
from hil_bench.devices.valve_state_machine import FAULT_STATES, RESET_BIT, ValveState
from hil_bench.errors import SdoAbort

_ACTIVATE: Final = 0b0111
_DISABLE: Final = 0b0001


def pressure_quantities(object_dictionary: ObjectDictionary) -> Mapping[str, RegisterValue]:
    """Return the quantities of a pressure transducer (CiA 404)."""
    od = object_dictionary
    value, unit = od.variable(0x6130, 1), od.variable(0x6131, 1)
    status, zero = od.variable(0x6150, 1), od.find(0x6125, 1)
    quantities = {
        "pressure": RegisterValue("Pa", lambda: value.value * UNITS[unit.value]),
        "valid": _bit(status, NOT_VALID, inverted=True),
        "over_range": _bit(status, POSITIVE_OVERLOAD),
        "under_range": _bit(status, NEGATIVE_OVERLOAD),
    }
    if zero is not None:
        quantities["zero"] = RegisterValue(
            "-", lambda: 0.0, partial(_pull, partial(zero.write, ZERO))
        )
    return quantities


def transducer_quantities(object_dictionary: ObjectDictionary) -> Mapping[str, RegisterValue]:
    """Return the quantities of a transducer of two pressures (CiA 404)."""
    od = object_dictionary
    value, unit, status = (od.variable(index, 2) for index in (0x6130, 0x6131, 0x6150))
    return {
        **pressure_quantities(od),
        "pressure_2": RegisterValue("Pa", lambda: value.value * UNITS[unit.value]),
        "valid_2": _bit(status, NOT_VALID, inverted=True),
    }


def encoder_quantities(object_dictionary: ObjectDictionary) -> Mapping[str, RegisterValue]:
    """Return the quantities of a position sensor (CiA 406)."""
    od = object_dictionary
    position, step = _position(od), od.variable(0x6005, 1)
    quantities = {
        "position": RegisterValue("m", lambda: position.value * step.value / POSITION_UNITS),
        "valid": _no_alarm(od),
    }
    speed = od.find(0x6030, 1)
    if speed is not None:
        speed_step = od.find(0x6005, 2)
        quantities["speed"] = RegisterValue(
            "m/s", lambda: speed.value * (speed_step.value if speed_step else 1) / SPEED_UNITS
        )
    return quantities


def redundant_quantities(object_dictionary: ObjectDictionary) -> Mapping[str, RegisterValue]:
    """Return the quantities of a position sensor with two measuring systems (CiA 406)."""
    od = object_dictionary
    position, step = od.variable(0x6020, 2), od.variable(0x6005, 1)
    speed, speed_step = od.variable(0x6030, 2), od.variable(0x6005, 2)
    return {
        **encoder_quantities(od),
        "position_2": RegisterValue("m", lambda: position.value * step.value / POSITION_UNITS),
        "speed_2": RegisterValue("m/s", lambda: speed.value * speed_step.value / SPEED_UNITS),
    }


def rotary_quantities(object_dictionary: ObjectDictionary) -> Mapping[str, RegisterValue]:
    """Return the quantities of a rotary position sensor (CiA 406).

    The angle begins again at 0 after `range_steps`, as the position on CANopen does.
    """
    od = object_dictionary
    position, resolution = _position(od), od.variable(0x6501)

    def is_scaled() -> bool:
        return bool(od.number(0x6000) & SCALING_BIT)

    def turn_steps() -> int:
        made_for = int(resolution.value)
        return od.number(0x6001, absent=made_for) if is_scaled() else made_for

    def range_steps() -> int:
        made_for = int(resolution.value) * od.number(0x6502, absent=1)
        return od.number(0x6002, absent=made_for) if is_scaled() else made_for

    quantities = {
        "angle": RegisterValue("rad", lambda: position.value * math.tau / turn_steps()),
        "valid": _no_alarm(od),
        "turn_steps": RegisterValue("-", turn_steps),
        "range_steps": RegisterValue("-", range_steps),
    }
    speed = od.find(0x6030, 1)
    if speed is not None:

        def shaft_speed() -> float:
            divider = od.number(0x6031, 4, absent=int(resolution.value))
            steps = speed.value * divider / od.number(0x6031, 3, absent=60)
            return float(steps * math.tau / turn_steps())

        quantities["speed"] = RegisterValue("rad/s", shaft_speed)
    return quantities


def valve_quantities(valve: ValveDevice) -> Mapping[str, RegisterValue]:
    """Return the quantities of a proportional valve (CiA 408).

    Commands need 0x604F = 1. Without it what is passive anyway (0) is taken and does nothing, since
    a controller may write all its outputs in each cycle.
    """
    od = valve.node.object_dictionary
    actual, demand, reference = od.variable(0x6301, 1), od.find(0x6310, 1), od.find(0x6311, 1)
    local = valve.local

    def fraction(increments: float) -> float:
        return increments / (reference.value if reference else REFERENCE)

    return {
        "spool_position": RegisterValue("-", lambda: fraction(actual.value)),
        "spool_demand": RegisterValue("-", lambda: fraction(demand.value) if demand else math.nan),
        "active": RegisterValue("-", lambda: float(valve.state is ValveState.ACTIVE)),
        "fault": RegisterValue("-", lambda: float(valve.state in FAULT_STATES)),
        "spool_setpoint": RegisterValue(
            "-",
            lambda: fraction(local.setpoint),
            _command(lambda value, now: valve.receive_local(None, value, now)),
        ),
        "control_word": RegisterValue(
            "-",
            lambda: local.control_word,
            _command(lambda value, now: valve.receive_local(int(value), None, now)),
        ),
        "enable": RegisterValue(
            "-",
            lambda: float(valve.state is ValveState.ACTIVE),
            _command(partial(_enable, valve)),
        ),
        "reset": RegisterValue("-", lambda: 0.0, partial(_reset, valve)),
        "watchdog": RegisterValue(
            "s", lambda: local.watchdog * 1e-9, partial(_set_watchdog, valve)
        ),
    }


_OF_SENSORS: Final = (
    (PressureKind, pressure_quantities),
    (TransducerKind, transducer_quantities),
    (RedundantEncoderKind, redundant_quantities),  # an `EncoderKind`, too
    (EncoderKind, encoder_quantities),
    (RotaryEncoderKind, rotary_quantities),
)


def quantities_of(
    kind: DeviceKind[Any], node: Node, fitting: Fitting
) -> Mapping[str, RegisterValue]:
    """Return the quantities of a device: what its kind fits it with, or those of our kinds."""
    if fitted := fitting.registers():
        return fitted
    if isinstance(kind, ValveKind):
        return valve_quantities(cast("ValveDevice", fitting.drives[0].device))
    makers = (make for ours, make in _OF_SENSORS if isinstance(kind, ours))
    make = next(makers, None)
    return {} if make is None else make(node.object_dictionary)


def _position(object_dictionary: ObjectDictionary) -> Variable:
    """Return the position of an encoder [steps]."""
    return object_dictionary.find(0x6004) or object_dictionary.variable(0x6020, 1)


def _no_alarm(object_dictionary: ObjectDictionary) -> RegisterValue:
    """Return the value that is 1 while an encoder has no alarm."""
    alarms = object_dictionary.find(0x6503)
    return RegisterValue("-", lambda: float(alarms is None or not alarms.value))


def _command(act: Callable[[float, int], None]) -> Callable[[float, int], None]:
    """Return a command that takes 0 where nobody may command the valve."""

    def write(value: float, now: int) -> None:
        try:
            act(value, now)
        except SdoAbort:
            if value:
                raise

    return write


def _enable(valve: ValveDevice, value: float, now: int) -> None:
    valve.receive_local(_ACTIVATE if value else _DISABLE, None, now)


def _reset(valve: ValveDevice, value: float, now: int) -> None:
    """Reset a fault of the valve, which stays disabled, where a client switches the coil on.

    Without a fault it does nothing, so that the coil may stay on.
    """
    if value and valve.state in FAULT_STATES:
        # The device acts on the edge of the bit, so it must have seen it low before.
        valve.receive_local(_DISABLE, 0.0, now)
        valve.receive_local(_DISABLE | RESET_BIT, 0.0, now)
        valve.receive_local(_DISABLE, 0.0, now)


def _set_watchdog(valve: ValveDevice, time: float, now: int) -> None:
    """Set the time between two commands; a new one counts from now.

    Raises:
        SdoAbort: it is negative.
    """
    if time < 0:
        raise SdoAbort(*abort_codes.VALUE_TOO_LOW)
    watchdog = round(time * 1e9)
    if watchdog != valve.local.watchdog:
        valve.local.watchdog = watchdog
        valve.local.received_at = now


def _bit(variable: Variable, mask: int, *, inverted: bool = False) -> RegisterValue:
    return RegisterValue("-", lambda: float(bool(variable.value & mask) != inverted))


def _pull(act: Callable[[], None], value: float, _now: int) -> None:
    """Act where a client switches a coil on; off does nothing."""
    if value:
        act()
