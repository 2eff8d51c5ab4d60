"""Events of a CAN controller and the reaction of its CANopen device (CiA 301, EMCY)."""

from enum import Enum, auto
from typing import Final

from hil_bench.canopen_device.emcy import COMMUNICATION, EmcyProducer

OVERRUN: Final = 0x8110
"""CAN overrun: objects lost."""

PASSIVE: Final = 0x8120
"""CAN in error passive mode."""

RECOVERED: Final = 0x8140
"""Recovered from bus-off."""


class CanEvent(Enum):
    """An event of a device's CAN controller."""

    PASSIVE = auto()
    """One of its error counters has come to 128."""
    ACTIVE = auto()
    """Both are below 128 again."""
    BUS_OFF = auto()
    """Its transmit error counter has come to 256: it neither sends nor hears."""
    RECOVERED = auto()
    """It takes part again, its counters at 0."""
    OVERRUN = auto()
    """A frame found the transmission buffer full, and is lost."""
    SENT_ALL = auto()
    """After an overrun, the buffer is empty."""


class CanErrors:
    """Turns what the CAN controller tells into emergencies."""

    def __init__(self, emcy: EmcyProducer) -> None:
        self._emcy = emcy

    def take(self, event: CanEvent) -> None:
        """Raise or clear the error of an event."""
        emcy = self._emcy
        if event is CanEvent.PASSIVE:
            emcy.raise_error(PASSIVE, COMMUNICATION)
        elif event is CanEvent.ACTIVE:
            emcy.clear_error(PASSIVE)
        elif event is CanEvent.OVERRUN:
            emcy.raise_error(OVERRUN, COMMUNICATION)
        elif event is CanEvent.SENT_ALL:
            emcy.clear_error(OVERRUN)
        elif event is CanEvent.RECOVERED:
            emcy.raise_error(RECOVERED, COMMUNICATION)
            emcy.clear_error(RECOVERED)
            emcy.clear_error(PASSIVE)
