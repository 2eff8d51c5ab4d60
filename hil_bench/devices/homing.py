"""Homing of a drive on its current position: CiA 402, mode 6, methods 35 and 37.

The rising edge of bit 4 of the control word starts it; once the axis stands, where it is counts as
0. Taking bit 4 away before that interrupts it. Bits 13, 12 and 10 of the status word: 0 0 0 under
way, 0 0 1 interrupted or not started, 0 1 1 complete. Neither method can fail, so bit 13 stays 0.

Sources: the bits by open masters and drives (a table quoted in several of them), the manuals of
Parker and Kollmorgen; the methods by the manual of KEB, ETG.6010 as open masters quote it, and
drivers of Festo and Ingenia drives. On the sign of a home offset (0x607C) manuals disagree: the
drive has none. Methods that search a switch or an index pulse have nothing to search here.
"""

from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.object_dictionary import Variable
from hil_bench.errors import SdoAbort

METHODS: Final = (35, 37)
"""What 0x6098 may hold; both are the current position, the first is the older number."""

_START: Final = 1 << 4
_REACHED, _ATTAINED = 1 << 10, 1 << 12


class Homing:
    """The course of homing, and the position that counts as 0.

    Args:
        method: 0x6098.

    Attributes:
        origin: position of the encoder that counts as 0 [increments].
        is_under_way: whether it was started and waits for the axis to stand.
    """

    def __init__(self, method: Variable) -> None:
        method.add_check(_check_method)
        self.origin = 0.0
        self.is_under_way = False
        self._is_attained = False
        self._was_set = False

    def restart(self) -> None:
        """Forget the home position, as at power-on."""
        self.origin = 0.0
        self.is_under_way = self._is_attained = self._was_set = False

    def receive(self, word: int, *, may_start: bool) -> None:
        """Take a control word.

        Args:
            word: the control word.
            may_start: whether the drive is enabled and in this mode.
        """
        is_set = bool(word & _START)
        if is_set and not self._was_set and may_start:
            self.is_under_way, self._is_attained = True, False
        elif not (is_set and may_start):
            self.is_under_way = False
        self._was_set = is_set

    def attain(self, position: float) -> None:
        """Let the present position count as 0.

        Args:
            position: by the origin of before [increments].
        """
        self.origin += position
        self.is_under_way, self._is_attained = False, True

    @property
    def status(self) -> int:
        """Bits of the status word."""
        if self.is_under_way:
            return 0
        return _REACHED | (_ATTAINED if self._is_attained else 0)


def _check_method(method: int) -> None:
    if method not in METHODS:
        raise SdoAbort(*abort_codes.VALUE)
