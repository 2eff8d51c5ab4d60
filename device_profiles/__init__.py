"""Device descriptions as data: one EDS file (CiA 306) a device, and where to find it."""

from pathlib import Path

VALVE_408 = Path(__file__).with_name("valve_408.eds")
"""Proportional valve with position feedback, profile CiA 408."""

PRESSURE_404 = Path(__file__).with_name("pressure_404.eds")
"""Pressure transducer with one channel, profile CiA 404."""

ENCODER_406 = Path(__file__).with_name("encoder_406.eds")
"""Absolute linear encoder, profile CiA 406."""

IMITATIONS = Path(__file__).with_name("imitations")
"""Folder of EDS files that imitate classes of real devices, see docs/devices.md."""

__all__ = ["ENCODER_406", "IMITATIONS", "PRESSURE_404", "VALVE_408"]
