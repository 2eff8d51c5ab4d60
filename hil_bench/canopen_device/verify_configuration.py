"""Verify configuration 0x1020 (CiA 301): does the device have what a master has written last?

A master writes date and time of its configuration into sub-index 1 and 2, and reads them at the
next boot-up (CiA 302-2). Any later change of the configuration sets both to 0; a master that finds
another date writes everything again.
"""

from typing import Final

from hil_bench.canopen_device.object_dictionary import Access, ObjectDictionary

_OBJECT: Final = 0x1020
_DATE_AND_TIME: Final = (1, 2)
_NO_CONFIGURATION: Final = frozenset({0x1003, 0x1010, 0x1011, 0x1013, _OBJECT})
_WRITABLE: Final = frozenset({Access.RW, Access.RWR})


def watch_configuration(object_dictionary: ObjectDictionary) -> None:
    """Let each change of the configuration of a device clear its 0x1020, where it has one.

    What an RPDO may write is no configuration.
    """
    found = [object_dictionary.find(_OBJECT, subindex) for subindex in _DATE_AND_TIME]
    stamps = [variable for variable in found if variable is not None]
    if not stamps:
        return

    def clear(_value: object) -> None:
        for stamp in stamps:
            stamp.value = 0

    for variable in object_dictionary:
        if variable.access in _WRITABLE and variable.index not in _NO_CONFIGURATION:
            variable.add_hook(clear)
