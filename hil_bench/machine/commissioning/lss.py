"""Finds devices that have no node-ID yet, by the LSS fastscan (CiA 305)."""

import logging
import struct
from typing import NamedTuple

from hil_drivers import Network

logger = logging.getLogger(__name__)

_REQUEST, _ANSWER = 0x7E5, 0x7E4
_SWITCH_GLOBAL, _WAITING = 0x04, 0
_FASTSCAN, _IDENTIFIED = 0x51, 0x4F
_BEGIN = 0x80
_PARTS = 4
_MESSAGE = struct.Struct("<BIBBB")

PATIENCE = 0.05
"""Time that a device has for its answer to one step [s]; CiA 305 leaves it to the master."""

SETTLING = 0.01
"""Time after the first answer for those of other devices [s], which must not pass for answers to
the next step."""

MOST_DEVICES = 127


class LssAddress(NamedTuple):
    """What tells a device without node-ID from all others: the four entries of 0x1018."""

    vendor_id: int
    product_code: int
    revision_number: int
    serial_number: int


class _Answers:
    def __init__(self, network: Network) -> None:
        self._network = network
        self._count = 0
        network.subscribe(_ANSWER, self._take)

    def _take(self, data: bytes, _now: float) -> bool:
        if len(data) != 8 or data[0] != _IDENTIFIED:
            return False
        self._count += 1
        return True

    def come(self, number: int, bit: int, part: int, following: int) -> bool:
        """Ask, and return whether any device answers."""
        before = self._count
        self._network.send(_REQUEST, _MESSAGE.pack(_FASTSCAN, number, bit, part, following))
        has_come = self._network.wait_for(lambda: self._count > before, PATIENCE)
        if has_come:
            self._network.pump(SETTLING)
        return has_come


def find_unconfigured(network: Network) -> list[LssAddress]:
    """Return the devices that wait for a node-ID; they wait on as before.

    A device that was found is in the LSS state CONFIGURATION, where it answers no further scan;
    at the end all are sent back to WAITING. One that answers all the same would be found for ever,
    so the scan ends where an address comes for the second time.
    """
    answers = _Answers(network)
    _return_to_waiting(network)
    found: list[LssAddress] = []
    while len(found) < MOST_DEVICES and (address := _scan(answers)) is not None:
        if address in found:
            logger.warning("a device answers LSS on after it was found: %s; scan ended", address)
            break
        found.append(address)
    _return_to_waiting(network)
    return found


def _scan(answers: _Answers) -> LssAddress | None:
    """Return the address of one device, None where no more answer."""
    if not answers.come(0, _BEGIN, 0, 0):
        return None
    numbers = []
    for part in range(_PARTS):
        number = _scan_part(answers, part)
        if number is None:
            return None
        numbers.append(number)
    return LssAddress(*numbers)


def _scan_part(answers: _Answers, part: int) -> int | None:
    """Return one entry of the address, bit by bit; None if the device is gone."""
    number = 0
    for bit in reversed(range(32)):
        # Whose entry agrees down to this bit, which is 0, answers; silence says that it is 1.
        if not answers.come(number, bit, part, part):
            number |= 1 << bit
    return number if answers.come(number, 0, part, (part + 1) % _PARTS) else None


def _return_to_waiting(network: Network) -> None:
    network.send(_REQUEST, bytes([_SWITCH_GLOBAL, _WAITING, 0, 0, 0, 0, 0, 0]))
    network.pump(PATIENCE)
