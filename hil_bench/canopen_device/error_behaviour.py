"""Error behaviour 0x1029 (CiA 301): the NMT state that an error leads to.

Sub-index 1 is for communication errors: a lost heartbeat, a life guarding event. The others are for
the error classes of the device profile. Values: 0 to PRE-OPERATIONAL if OPERATIONAL, 1 no change,
2 to STOPPED.
"""

from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.object_dictionary import ObjectDictionary

COMMUNICATION_ERROR: Final = 1
"""Sub-index of communication errors."""

_OBJECT: Final = 0x1029
_PRE_OPERATIONAL: Final = 0
_STOPPED: Final = 2


class ErrorBehaviour:
    """Knows what 0x1029 asks for; where it is absent, that is PRE-OPERATIONAL."""

    def __init__(self, object_dictionary: ObjectDictionary) -> None:
        self._object_dictionary = object_dictionary
        for variable in object_dictionary:
            if variable.index == _OBJECT and variable.subindex:
                variable.add_check(_check)

    def state_after(self, subindex: int, state: NmtState) -> NmtState | None:
        """Return the NMT state after an error of the class `subindex`, None for no change."""
        behaviour = self._object_dictionary.number(_OBJECT, subindex)
        if behaviour == _STOPPED:
            return NmtState.STOPPED
        if behaviour == _PRE_OPERATIONAL and state is NmtState.OPERATIONAL:
            return NmtState.PRE_OPERATIONAL
        return None


def _check(value: int) -> None:
    """Refuse values that mean nothing.

    Raises:
        SdoAbort: 0609 0030.
    """
    if value > _STOPPED:
        raise SdoAbort(*abort_codes.VALUE)
