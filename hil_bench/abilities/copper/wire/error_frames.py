"""Errors of a bus of copper as the CAN adapter of the controller reports them.

The layout is that of SocketCAN (`linux/can/error.h`).
"""

from typing import Final

from hil_bench.abilities.copper.wire.attempt import ErrorKind
from hil_bench.abilities.copper.wire.station import Station
from hil_bench.abilities.copper.wire.wire import ErrorFrame
from hil_bench.canopen_device.emcy import CanEvent
from hil_bench.canopen_device.frame import Frame
from hil_bench.frame import ERROR_FLAG

CONTROLLER: Final = 0x004
PROTOCOL: Final = 0x008
NO_ACK: Final = 0x020
BUS_OFF: Final = 0x040
BUS_ERROR: Final = 0x080
RESTARTED: Final = 0x100
COUNTERS: Final = 0x200

BIT: Final = 0x01
STUFF: Final = 0x04
BIT_DOMINANT: Final = 0x08
SENDING: Final = 0x80

RX_PASSIVE: Final = 0x10
TX_PASSIVE: Final = 0x20
ACTIVE: Final = 0x40

_PASSIVE_FROM: Final = 128
_MOST: Final = 0xFF


def broken_frame(error: ErrorFrame, adapter: Station, bus: int) -> Frame:
    """Return the error frame of an adapter for a transmission that failed.

    Args:
        error: what failed.
        adapter: the station that reports.
        bus: number of the bus.
    """
    is_own, kind = error.station is adapter, error.broken.kind
    classes = PROTOCOL | BUS_ERROR | COUNTERS
    if is_own and kind is ErrorKind.ACK:
        classes |= NO_ACK
    what = BIT | SENDING if is_own else STUFF
    if kind is ErrorKind.DOMINANT:
        what |= BIT_DOMINANT
    return _frame(classes, adapter, bus, protocol=what)


def event_frame(event: CanEvent, adapter: Station, bus: int) -> Frame | None:
    """Return the error frame of an adapter for its own event; None for an event without one."""
    if event is CanEvent.BUS_OFF:
        return _frame(BUS_OFF | COUNTERS, adapter, bus)
    if event is CanEvent.RECOVERED:
        return _frame(RESTARTED | COUNTERS, adapter, bus)
    if event is CanEvent.ACTIVE:
        return _frame(CONTROLLER | COUNTERS, adapter, bus, controller=ACTIVE)
    if event is CanEvent.PASSIVE:
        status = TX_PASSIVE * (adapter.tec >= _PASSIVE_FROM)
        status |= RX_PASSIVE * (adapter.rec >= _PASSIVE_FROM)
        return _frame(CONTROLLER | COUNTERS, adapter, bus, controller=status)
    return None


def _frame(
    classes: int, adapter: Station, bus: int, *, controller: int = 0, protocol: int = 0
) -> Frame:
    counters = min(adapter.tec, _MOST), min(adapter.rec, _MOST)
    data = bytes((0, controller, protocol, 0, 0, 0, *counters))
    return Frame(ERROR_FLAG | classes, data, bus=bus)
