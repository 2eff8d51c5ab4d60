"""The stored parameters of a device as JSON text, which a person can read and compare."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

from hil_bench.canopen_device.errors import StorageError

Identity = tuple[int, int, int]
"""Vendor-ID, product code and revision number: whose parameters these are (0x1018)."""


@dataclass(frozen=True, slots=True)
class StoredParameters:
    """The contents of a device's non-volatile memory.

    Attributes:
        identity: of the device that stored them.
        node_id: node-ID that LSS stored, None where it did not.
        bit_timing: index of the bit timing that LSS stored, None where it did not.
        values: objects whose value differs from the default, by index and sub-index, as an SDO
            transfer carries them.
    """

    identity: Identity
    node_id: int | None = None
    bit_timing: int | None = None
    values: Mapping[tuple[int, int], bytes] = field(default_factory=dict)

    def encode(self) -> bytes:
        """Return the text."""
        document = {
            "identity": list(self.identity),
            "node_id": self.node_id,
            "bit_timing": self.bit_timing,
            "objects": {
                f"{index:04X}.{subindex:02X}": raw.hex()
                for (index, subindex), raw in sorted(self.values.items())
            },
        }
        return json.dumps(document, indent=1).encode() + b"\n"

    @classmethod
    def decode(cls, data: bytes) -> "StoredParameters":
        """Return the contents of a text that `encode` made.

        Raises:
            StorageError: it is another one.
        """
        try:
            document = json.loads(data)
            vendor, product, revision = map(_number, document["identity"])
            return cls(
                identity=(vendor, product, revision),
                node_id=_optional_number(document["node_id"]),
                bit_timing=_optional_number(document["bit_timing"]),
                values={
                    _multiplexer(name): bytes.fromhex(raw)
                    for name, raw in document["objects"].items()
                },
            )
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise StorageError(f"the stored parameters are malformed: {error!r}") from error


def _multiplexer(name: str) -> tuple[int, int]:
    index, subindex = name.split(".")
    return int(index, 16), int(subindex, 16)


def _number(value: object) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise TypeError(value)
    return value


def _optional_number(value: object) -> int | None:
    return None if value is None else _number(value)
