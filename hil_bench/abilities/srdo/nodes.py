"""SRDOs for the nodes whose objects have them."""

from typing import Final

from hil_bench.canopen_device.node import ServiceMaker
from hil_bench.canopen_device.object_dictionary import ObjectDictionary

_INDICES: Final = range(0x1301, 0x1400)
"""Parameters, mappings, the mark of a valid configuration, signatures."""


def services(od: ObjectDictionary) -> tuple[ServiceMaker, ...]:
    """Return the maker of the SRDOs of a device, none where it has no such objects."""
    if not od.indices(_INDICES):
        return ()
    from hil_bench.abilities.srdo.srdo import Srdos  # noqa: PLC0415 - few have them

    return (Srdos,)
