"""Why a Modbus server refuses a request.

Source: MODBUS Application Protocol Specification V1.1b3, chapter 7.
"""

from enum import IntEnum

from hil_bench.errors import HilBenchError


class ExceptionCode(IntEnum):
    """The exception codes that this server uses."""

    ILLEGAL_FUNCTION = 1
    ILLEGAL_DATA_ADDRESS = 2
    ILLEGAL_DATA_VALUE = 3
    SERVER_DEVICE_FAILURE = 4
    SERVER_DEVICE_BUSY = 6
    GATEWAY_TARGET_FAILED = 11


class ModbusException(HilBenchError):  # noqa: N818 - the specification's word
    """A request was refused.

    Attributes:
        code: the reason, as it goes to the client.
    """

    def __init__(self, code: ExceptionCode) -> None:
        super().__init__(f"Modbus exception {code.value}: {code.name}")
        self.code = code
