"""Requests and responses as bytes, by pymodbus; nothing else of the project knows that library.

Of pymodbus only its messages are used. Its server is not, for the reasons in decision 0020: it
loses pipelined requests, answers an illegal count with exception 1 of function 0, and has one
identification for all units of a process.

Sources: MODBUS Application Protocol Specification V1.1b3, chapter 6 (functions, and which exception
they ask for), 6.21 (device identification).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.bit_message import (
    ReadCoilsResponse,
    ReadDiscreteInputsResponse,
    WriteMultipleCoilsResponse,
    WriteSingleCoilResponse,
)
from pymodbus.pdu.mei_message import ReadDeviceInformationResponse
from pymodbus.pdu.register_message import (
    MaskWriteRegisterResponse,
    ReadHoldingRegistersResponse,
    ReadInputRegistersResponse,
    ReadWriteMultipleRegistersResponse,
    WriteMultipleRegistersResponse,
    WriteSingleRegisterResponse,
)

from hil_bench.abilities.modbus.protocol import register_map

IDENTIFY: Final = 0x2B
_MEI_IDENTIFICATION: Final = 0x0E

_TABLES: Final = {
    1: register_map.Table.COILS,
    2: register_map.Table.DISCRETE_INPUTS,
    3: register_map.Table.HOLDING_REGISTERS,
    4: register_map.Table.INPUT_REGISTERS,
    5: register_map.Table.COILS,
    6: register_map.Table.HOLDING_REGISTERS,
    15: register_map.Table.COILS,
    16: register_map.Table.HOLDING_REGISTERS,
    22: register_map.Table.HOLDING_REGISTERS,
    23: register_map.Table.HOLDING_REGISTERS,
}
_READS: Final = frozenset({1, 2, 3, 4})
WRITES: Final = frozenset({5, 6, 15, 16, 22, 23})
"""Functions that write."""
MASK_WRITE: Final = 22
READ_WRITE: Final = 23
_SINGLE_WRITES: Final = frozenset({5, 6})
_COIL_VALUES: Final = (b"\x00\x00", b"\xff\x00")

_MOST: Final = {1: 2000, 2: 2000, 3: 125, 4: 125, 15: 1968, 16: 123, 23: 121}
"""Largest count of each function; of function 23, what it writes."""
_MOST_READ_BESIDE: Final = 125
"""Largest count that function 23 reads."""

_BASIC: Final = 3
_REGULAR: Final = 7
_SPECIFIC: Final = 4
_REGULAR_CONFORMITY: Final = 0x82  # regular identification, stream and individual access

_DECODER: Final = DecodePDU(is_server=True)


@dataclass(frozen=True, slots=True)
class Request:
    """One request, its form checked.

    Attributes:
        function: function code.
        table: what it reads or writes.
        address: first register or bit; of function 23, the first that it writes.
        count: how many.
        words: what it writes, or its two masks; empty for a read.
        read_address: first register that function 23 reads.
        read_count: how many function 23 reads.
    """

    function: int
    table: register_map.Table
    address: int
    count: int
    words: Sequence[int] = ()
    read_address: int = 0
    read_count: int = 0

    @property
    def is_read(self) -> bool:
        """Return True if it reads."""
        return self.function in _READS


def decode_request(pdu: bytes) -> Request:
    """Return the request in a PDU.

    Raises:
        ModbusException: 1, there is no such function; 3, its count, length or value is wrong.
    """
    function = pdu[0]
    table = _TABLES.get(function)
    if table is None:
        raise register_map.ModbusException(register_map.ExceptionCode.ILLEGAL_FUNCTION)
    if not _is_well_formed(pdu) or (function == 5 and pdu[3:5] not in _COIL_VALUES):
        raise register_map.ModbusException(register_map.ExceptionCode.ILLEGAL_DATA_VALUE)
    message: Any = _DECODER.decode(pdu)
    if message is None:
        raise register_map.ModbusException(register_map.ExceptionCode.ILLEGAL_DATA_VALUE)
    if function in _READS:
        return Request(function, table, message.address, message.count)
    if function == MASK_WRITE:
        return Request(function, table, message.address, 1, (message.and_mask, message.or_mask))
    if function == READ_WRITE:
        return Request(
            function,
            table,
            message.write_address,
            message.write_count,
            message.write_registers,
            message.read_address,
            message.read_count,
        )
    words = [int(word) for word in (message.bits if table.holds_bits else message.registers)]
    count = 1 if function in _SINGLE_WRITES else message.count
    return Request(function, table, message.address, count, words[:count])


def encode_response(request: Request, words: Sequence[int]) -> bytes:
    """Return the response to a request that was obeyed.

    Args:
        request: the request.
        words: what was read; for a pure write it does not matter.
    """
    return _encode(_response(request, words))


def encode_exception(function: int, code: register_map.ExceptionCode) -> bytes:
    """Return the response to a request that was refused."""
    return _encode(ExceptionResponse(function & 0x7F, code))


def identify(pdu: bytes, identification: register_map.DeviceIdentification) -> bytes:
    """Return the response to a request for the device identification.

    Raises:
        ModbusException: 1, it asks for something else; 2, there is no such object; 3, it is
            malformed.
    """
    if len(pdu) < 2 or pdu[1] != _MEI_IDENTIFICATION:
        raise register_map.ModbusException(register_map.ExceptionCode.ILLEGAL_FUNCTION)
    if len(pdu) != 4 or not 1 <= pdu[2] <= _SPECIFIC:
        raise register_map.ModbusException(register_map.ExceptionCode.ILLEGAL_DATA_VALUE)
    code, wanted = pdu[2], pdu[3]
    objects = _identification_objects(identification)
    if code == _SPECIFIC:
        if wanted not in objects:
            raise register_map.ModbusException(register_map.ExceptionCode.ILLEGAL_DATA_ADDRESS)
        chosen = {wanted: objects[wanted]}
    else:
        end = _BASIC if code == 1 else _REGULAR
        first = wanted if wanted in objects and wanted < end else 0
        chosen = {key: text for key, text in objects.items() if first <= key < end}
    response = ReadDeviceInformationResponse(read_code=code, information=chosen)
    response.conformity = _REGULAR_CONFORMITY
    return _encode(response)


def _identification_objects(identification: register_map.DeviceIdentification) -> dict[int, bytes]:
    """Return the objects that are there, by their number."""
    texts = (
        identification.vendor_name,
        identification.product_code,
        identification.revision,
        identification.vendor_url,
        identification.product_name,
        identification.model_name,
        identification.user_application_name,
    )
    return {number: text.encode("ascii") for number, text in enumerate(texts) if text}


def _is_well_formed(pdu: bytes) -> bool:
    """Return True if length, count and byte count of a PDU are as its function says."""
    function = pdu[0]
    if function in _SINGLE_WRITES:
        return len(pdu) == 5
    if function == MASK_WRITE:
        return len(pdu) == 7
    if function == READ_WRITE:
        read_count = int.from_bytes(pdu[3:5], "big")
        return 1 <= read_count <= _MOST_READ_BESIDE and _is_list(pdu, 9)
    if function in _READS:
        return len(pdu) == 5 and 1 <= int.from_bytes(pdu[3:5], "big") <= _MOST[function]
    return _is_list(pdu, 5)


def _is_list(pdu: bytes, end: int) -> bool:
    """Return True if a count that ends at `end`, a byte count and the values after it agree."""
    if len(pdu) <= end or len(pdu) != end + 1 + pdu[end]:
        return False
    count = int.from_bytes(pdu[end - 2 : end], "big")
    size = (
        2 * count if _TABLES[pdu[0]] is register_map.Table.HOLDING_REGISTERS else (count + 7) // 8
    )
    return 1 <= count <= _MOST[pdu[0]] and pdu[end] == size


def _response(request: Request, words: Sequence[int]) -> ModbusPDU:
    if request.is_read or request.function == READ_WRITE:
        return _read_response(request, words)
    address, count = request.address, request.count
    match request.function:
        case 5:
            return WriteSingleCoilResponse(address=address, bits=[bool(request.words[0])])
        case 6:
            return WriteSingleRegisterResponse(address=address, registers=request.words)
        case 15:
            return WriteMultipleCoilsResponse(address=address, count=count)
        case 22:
            and_mask, or_mask = request.words
            return MaskWriteRegisterResponse(address=address, and_mask=and_mask, or_mask=or_mask)
        case _:
            return WriteMultipleRegistersResponse(address=address, count=count)


def _read_response(request: Request, words: Sequence[int]) -> ModbusPDU:
    match request.function:
        case 1:
            return ReadCoilsResponse(bits=[bool(word) for word in words])
        case 2:
            return ReadDiscreteInputsResponse(bits=[bool(word) for word in words])
        case 3:
            return ReadHoldingRegistersResponse(registers=words)
        case 23:
            return ReadWriteMultipleRegistersResponse(registers=words)
        case _:
            return ReadInputRegistersResponse(registers=words)


def _encode(message: ModbusPDU) -> bytes:
    return bytes([message.function_code]) + message.encode()
