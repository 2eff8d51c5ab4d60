"""The pre-defined connection set (CiA 301): COB-IDs of a device whose EDS gives no others."""

from typing import Final, NamedTuple

from hil_bench.canopen_device.cob_id import DISABLED


class Predefined(NamedTuple):
    """A COB-ID parameter's default.

    Attributes:
        cob_id: for node-ID 0.
        node_ids: 1 where the node-ID is added, else 0.
    """

    cob_id: int
    node_ids: int


_FIXED: Final = {
    (0x1005, 0): Predefined(0x080, 0),
    (0x1012, 0): Predefined(0x100, 0),
    (0x1014, 0): Predefined(0x080, 1),
    (0x1200, 1): Predefined(0x600, 1),
    (0x1200, 2): Predefined(0x580, 1),
}
_PDOS: Final = ((range(0x1400, 0x1600), 0x200), (range(0x1800, 0x1A00), 0x180))
_PREDEFINED_PDOS: Final = 4
_SDO_SERVERS: Final = range(0x1201, 0x1280)


def predefined_default(index: int, subindex: int) -> Predefined | None:
    """Return the default of a COB-ID parameter, None where the entry is none.

    PDOs after the fourth, and SDO servers after the first, are off.
    """
    for indices, first in _PDOS:
        if index in indices and subindex == 1:
            number = index - indices.start
            if number < _PREDEFINED_PDOS:
                return Predefined(first + 0x100 * number, 1)
            return Predefined(DISABLED, 0)
    if index in _SDO_SERVERS and subindex in {1, 2}:
        return Predefined(DISABLED, 0)
    return _FIXED.get((index, subindex))
