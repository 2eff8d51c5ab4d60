"""Numbers and values as an EDS writes them (CiA 306)."""

import math
import re
import struct
from typing import Final

from hil_bench.canopen_device.datatypes import (
    BooleanType,
    BytesType,
    DataType,
    IntegerType,
    RealType,
    Value,
)

_SUM: Final = re.compile(
    r"(?:\$NODEID\s*\+\s*)?(?P<number>-?(?:0X[0-9A-F]{1,40}|[0-9]{1,40}))(?:\s*\+\s*\$NODEID)?",
    re.IGNORECASE,
)
_AMBIGUOUS: Final = re.compile(r"-?0+(?:[1-9][0-9]+|[89])")
"""Decimal digits after a zero that mean another number in octal."""

_LONGEST_SHOWN: Final = 40


def shown(text: str) -> str:
    """Return text from a file as a message quotes it: its beginning, where it is long."""
    return repr(text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}...")


def parse_integer(text: str, node_id: int = 0) -> int:
    """Return the number of `text`: decimal, 0x hexadecimal, with or without `$NODEID+`.

    Raises:
        ValueError: it is none of these; the message says what would be right.
    """
    stripped = text.strip()
    if stripped.upper() == "$NODEID":
        return node_id
    match = _SUM.fullmatch(stripped)
    if match is None or stripped.upper().count("$NODEID") > 1:
        raise ValueError(f"{shown(text)} is no number; write 384, 0x180 or $NODEID+0x180")
    digits = match["number"]
    if _AMBIGUOUS.fullmatch(digits):
        decimal = int(digits)
        raise ValueError(
            f"{shown(text)} has a leading zero, which is octal in CiA 306 and decimal to most "
            f"tools; write {decimal} or 0x{abs(decimal):X}"
        )
    base = 16 if "X" in digits.upper() else 10
    return int(digits, base) + (node_id if "$" in stripped else 0)


def parse_value(text: str, data_type: DataType, node_id: int) -> Value:
    """Return the value of `data_type` that `text` means.

    ValueError where it means none; the message says what would be right.
    """
    if isinstance(data_type, IntegerType):
        return _parse_ranged_integer(text, data_type, node_id)
    if isinstance(data_type, RealType):
        return _parse_real(text, data_type)
    if isinstance(data_type, BooleanType):
        return _parse_boolean(text)
    if isinstance(data_type, BytesType):
        return _parse_bytes(text)
    return _parse_string(text, data_type)


def _parse_ranged_integer(text: str, data_type: IntegerType, node_id: int) -> int:
    value = parse_integer(text, node_id)
    low, high = data_type.low, data_type.high
    is_pattern = text.strip().upper().startswith("0X")
    if data_type.signed and is_pattern and value < 1 << data_type.bits:
        value = int.from_bytes(value.to_bytes(data_type.size, "little"), "little", signed=True)
    if low is None or high is None or not low <= value <= high:
        raise ValueError(f"{shown(text)} is outside {data_type.name}; write {low} to {high}")
    return value


def _parse_boolean(text: str) -> bool:
    if parse_integer(text) not in {0, 1}:
        raise ValueError(f"{shown(text)} is no BOOLEAN; write 0 or 1")
    return bool(parse_integer(text))


def _parse_real(text: str, data_type: RealType) -> float:
    """Return a decimal number, rounded to the type, or that of a 0x bit pattern.

    Raises:
        ValueError: it is neither.
    """
    stripped = text.strip().lower()
    try:
        if stripped.startswith("0x"):
            raw = int(stripped, 16).to_bytes(data_type.size, "little")
        else:
            raw = data_type.encode(float(stripped))
    except (ValueError, OverflowError, struct.error):
        raise ValueError(_no_real(text, data_type)) from None
    value = data_type.decode(raw)
    # float("3e800000") is an infinity, and was meant as the pattern of 0.25.
    if math.isinf(value) and not stripped.startswith("0x") and "inf" not in stripped:
        raise ValueError(_no_real(text, data_type))
    return value


def _no_real(text: str, data_type: RealType) -> str:
    pattern = data_type.encode(1.5)[::-1].hex().upper()
    return f"{shown(text)} is no {data_type.name}; write 1.5 or its bit pattern 0x{pattern}"


def _parse_bytes(text: str) -> bytes:
    try:
        return bytes.fromhex(text)
    except ValueError:
        raise ValueError(
            f"{shown(text)} is no byte string; write hexadecimal pairs: 01 A2 FF"
        ) from None


def _parse_string(text: str, data_type: DataType) -> str:
    try:
        data_type.encode(text)
    except UnicodeEncodeError:
        raise ValueError(f"{shown(text)} has characters outside {data_type.name}") from None
    return text
