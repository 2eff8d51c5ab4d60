"""NMT startup 0x1F80 (CiA 302-2), as far as it concerns a device that is no NMT master."""

from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.object_dictionary import ObjectDictionary

_OBJECT: Final = 0x1F80
_NO_SELF_START: Final = 1 << 2
"""The device stays in PRE-OPERATIONAL after boot-up until the NMT master starts it."""
_NO_START_OF_OTHERS: Final = 1 << 3
"""Says what an NMT master does not do, so it is true of every other device."""


class Startup:
    """Knows whether the device enters OPERATIONAL by itself; without 0x1F80 it does not."""

    def __init__(self, object_dictionary: ObjectDictionary) -> None:
        self._startup = object_dictionary.find(_OBJECT)
        if self._startup is not None:
            self._startup.add_check(_check)

    @property
    def is_automatic(self) -> bool:
        """True if OPERATIONAL follows the boot-up at once."""
        return self._startup is not None and not self._startup.value & _NO_SELF_START


def _check(startup: int) -> None:
    """Refuse what would make this device an NMT master.

    Raises:
        SdoAbort: 0609 0030.
    """
    if startup & ~(_NO_SELF_START | _NO_START_OF_OTHERS):
        raise SdoAbort(*abort_codes.VALUE)
