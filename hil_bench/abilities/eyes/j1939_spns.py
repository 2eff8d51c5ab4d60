"""Signals that SAE J1939-71 defines, for reading a bus of which nothing is known.

Places, resolutions and units as engine makers publish them in their interface descriptions and as
public decoders have them; the digital annex of J1939 was not at hand. Few: most machines send them.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from hil_bench.abilities.eyes.known_ecu import KnownSignal
from hil_bench.abilities.j1939.protocol.signals import Signal


def _byte(place: int, resolution: float, offset: float = 0.0) -> Signal:
    """Return a signal of one byte, counted from 1 as the standard does."""
    return Signal(8 * (place - 1), 8, resolution, offset)


def _word(place: int, resolution: float, offset: float = 0.0) -> Signal:
    """Return a signal of two bytes, the first counted from 1."""
    return Signal(8 * (place - 1), 16, resolution, offset)


def _spn(number: int, name: str, signal: Signal, unit: str) -> KnownSignal:
    return KnownSignal(f"{name} (SPN {number})", signal, unit)


_RPM: Final = 0.125
_KELVIN: Final = 0.03125
_ZERO: Final = -273.0

SPNS: Final[Mapping[int, tuple[KnownSignal, ...]]] = MappingProxyType(
    {
        0xF001: (_spn(521, "brake pedal position", _byte(2, 0.4), "%"),),
        0xF002: (
            _spn(191, "output shaft speed", _word(2, _RPM), "rpm"),
            _spn(161, "input shaft speed", _word(6, _RPM), "rpm"),
        ),
        0xF003: (
            _spn(91, "accelerator pedal position 1", _byte(2, 0.4), "%"),
            _spn(92, "engine load", _byte(3, 1.0), "%"),
        ),
        0xF004: (
            _spn(512, "demanded torque", _byte(2, 1.0, -125.0), "%"),
            _spn(513, "actual torque", _byte(3, 1.0, -125.0), "%"),
            _spn(190, "engine speed", _word(4, _RPM), "rpm"),
        ),
        0xFEE5: (_spn(247, "engine hours", Signal(0, 32, 0.05), "h"),),
        0xFEEE: (
            _spn(110, "coolant temperature", _byte(1, 1.0, -40.0), "°C"),
            _spn(174, "fuel temperature", _byte(2, 1.0, -40.0), "°C"),
            _spn(175, "oil temperature", _word(3, _KELVIN, _ZERO), "°C"),
        ),
        0xFEEF: (
            _spn(94, "fuel delivery pressure", _byte(1, 4.0), "kPa"),
            _spn(98, "oil level", _byte(3, 0.4), "%"),
            _spn(100, "oil pressure", _byte(4, 4.0), "kPa"),
        ),
        0xFEF1: (_spn(84, "wheel-based speed", _word(2, 1 / 256), "km/h"),),
        0xFEF2: (
            _spn(183, "fuel rate", _word(1, 0.05), "l/h"),
            _spn(51, "throttle position", _byte(7, 0.4), "%"),
        ),
        0xFEF5: (
            _spn(108, "barometric pressure", _byte(1, 0.5), "kPa"),
            _spn(170, "cab temperature", _word(2, _KELVIN, _ZERO), "°C"),
            _spn(171, "ambient temperature", _word(4, _KELVIN, _ZERO), "°C"),
        ),
        0xFEF6: (
            _spn(102, "boost pressure", _byte(2, 2.0), "kPa"),
            _spn(105, "intake manifold temperature", _byte(3, 1.0, -40.0), "°C"),
            _spn(173, "exhaust temperature", _word(6, _KELVIN, _ZERO), "°C"),
        ),
        0xFEF7: (
            _spn(167, "charging voltage", _word(3, 0.05), "V"),
            _spn(168, "battery voltage", _word(5, 0.05), "V"),
            _spn(158, "keyswitch voltage", _word(7, 0.05), "V"),
        ),
        0xFEFC: (_spn(96, "fuel level", _byte(2, 0.4), "%"),),
    }
)
"""The signals of each parameter group."""
