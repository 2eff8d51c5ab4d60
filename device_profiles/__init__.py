"""Device descriptions as data: EDS files (CiA 306), register maps, and where to find them."""

from pathlib import Path

VALVE_408 = Path(__file__).with_name("valve_408.eds")
"""Proportional valve with position feedback, profile CiA 408."""

PRESSURE_404 = Path(__file__).with_name("pressure_404.eds")
"""Pressure transducer with one channel, profile CiA 404."""

TRANSDUCER_404 = Path(__file__).with_name("transducer_404.eds")
"""Transducer of two pressures and a temperature, profile CiA 404."""

DRIVE_402 = Path(__file__).with_name("drive_402.eds")
"""Drive of an axis that turns, profile CiA 402."""

ENCODER_406 = Path(__file__).with_name("encoder_406.eds")
"""Absolute linear encoder, profile CiA 406."""

ROTARY_ENCODER_406 = Path(__file__).with_name("rotary_encoder_406.eds")
"""Absolute multi-turn rotary encoder, profile CiA 406."""
ENCODER_REDUNDANT_406 = Path(__file__).with_name("encoder_redundant_406.eds")
"""Absolute linear encoder with two measuring systems, profile CiA 406."""

IMITATIONS = Path(__file__).with_name("imitations")
"""Folder of EDS files that imitate classes of real devices, see docs/devices.md."""

REGISTERS = Path(__file__).with_name("registers")
"""Folder of register maps (TOML), one a device profile by its name, see docs/modbus.md."""

__all__ = [
    "DRIVE_402",
    "ENCODER_406",
    "ENCODER_REDUNDANT_406",
    "IMITATIONS",
    "PRESSURE_404",
    "REGISTERS",
    "ROTARY_ENCODER_406",
    "TRANSDUCER_404",
    "VALVE_408",
]
