"""SDO abort codes with the standard's words (CiA 301, SDO abort codes).

Each constant is the argument pair of the error: ``raise SdoAbort(*abort_codes.NO_OBJECT)``.
"""

from typing import Final

AbortCode = tuple[int, str]

TOGGLE: Final = (0x05030000, "toggle bit not alternated")
TIME_OUT: Final = (0x05040000, "SDO protocol timed out")
COMMAND_SPECIFIER: Final = (0x05040001, "client/server command specifier not valid or unknown")
BLOCK_SIZE: Final = (0x05040002, "invalid block size")
SEQUENCE_NUMBER: Final = (0x05040003, "invalid sequence number")
CRC: Final = (0x05040004, "CRC error")
OUT_OF_MEMORY: Final = (0x05040005, "out of memory")
UNSUPPORTED_ACCESS: Final = (0x06010000, "unsupported access to an object")
WRITE_ONLY: Final = (0x06010001, "attempt to read a write only object")
READ_ONLY: Final = (0x06010002, "attempt to write a read only object")
NO_OBJECT: Final = (0x06020000, "object does not exist in the object dictionary")
NOT_MAPPABLE: Final = (0x06040041, "object cannot be mapped to the PDO")
PDO_LENGTH: Final = (
    0x06040042,
    "the number and length of the objects to be mapped would exceed PDO length",
)
PARAMETER_INCOMPATIBLE: Final = (0x06040043, "general parameter incompatibility reason")
INTERNAL_INCOMPATIBLE: Final = (0x06040047, "general internal incompatibility in the device")
HARDWARE: Final = (0x06060000, "access failed due to a hardware error")
LENGTH: Final = (
    0x06070010,
    "data type does not match, length of service parameter does not match",
)
LENGTH_TOO_HIGH: Final = (
    0x06070012,
    "data type does not match, length of service parameter too high",
)
LENGTH_TOO_LOW: Final = (
    0x06070013,
    "data type does not match, length of service parameter too low",
)
NO_SUBINDEX: Final = (0x06090011, "sub-index does not exist")
VALUE: Final = (0x06090030, "invalid value for parameter")
VALUE_TOO_HIGH: Final = (0x06090031, "value of parameter written too high")
VALUE_TOO_LOW: Final = (0x06090032, "value of parameter written too low")
GENERAL: Final = (0x08000000, "general error")
NOT_STORED: Final = (0x08000020, "data cannot be transferred or stored to the application")
LOCAL_CONTROL: Final = (
    0x08000021,
    "data cannot be transferred or stored to the application because of local control",
)
DEVICE_STATE: Final = (
    0x08000022,
    "data cannot be transferred or stored to the application because of the present device state",
)
NO_DATA: Final = (0x08000024, "no data available")
