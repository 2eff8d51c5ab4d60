"""Emergency messages as a device sends them (CiA 301, emergency object)."""

from typing import NamedTuple

from canopen.emcy import EmcyError

MEANINGS = {
    0x8110: "CAN overrun, objects lost",
    0x8120: "CAN in error passive mode",
    0x8130: "life guard or heartbeat error",
    0x8140: "recovered from bus off",
    0x8150: "CAN-ID collision",
    0x8210: "PDO not processed due to length error",
    0x8220: "PDO length exceeded",
    0x8240: "unexpected SYNC data length",
    0x8250: "RPDO time-out",
}
"""Emergency error codes that CiA 301 lists one by one; others have the meaning of their class."""


class Emergency(NamedTuple):
    """One emergency message.

    Attributes:
        code: emergency error code; 0x0000 to 0x00FF means that an error has gone.
        register: error register 0x1001 as it was then.
        manufacturer: the five manufacturer-specific bytes.
        received_at: time of reception on the network's clock [s].
    """

    code: int
    register: int
    manufacturer: bytes
    received_at: float

    @property
    def is_reset(self) -> bool:
        """Return True if this message says that an error has gone."""
        return self.code < 0x0100

    @property
    def meaning(self) -> str:
        """The meaning of the code, in the words of CiA 301."""
        error = EmcyError(self.code, self.register, self.manufacturer, self.received_at)
        return MEANINGS.get(self.code) or error.get_desc() or "code without a meaning in CiA 301"
