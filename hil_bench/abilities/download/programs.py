"""The memory for programs of a device, as a node's table gives it."""

from collections.abc import Callable, Mapping
from typing import Any

from hil_bench.abilities.download.program_memory import (
    DATA,
    Checksum,
    MemoryConfig,
    program_memories,
)
from hil_bench.canopen_device.node import Node
from hil_bench.config.settings import Key, Problems, convert, read_table
from hil_bench.config.values import as_table, choice, integer, number
from hil_bench.units import MILLISECOND

_DEFAULT = MemoryConfig()
PROGRAM_KEYS = (
    Key("largest_bytes", integer(1, 1 << 24), _DEFAULT.largest),
    Key("checksum", choice([each.value for each in Checksum]), Checksum.NONE.value),
    Key("write_ms", number(MILLISECOND, low=0.0, high=600_000.0), 0.0, MILLISECOND, "write"),
)


def program_memory(value: object) -> dict[str, object]:
    """Return a table that describes the memory of a device's programs."""
    right = 'give a table, as in { largest_bytes = 262144, checksum = "crc32" }'
    table = as_table(value, right)
    _read(table)
    return table


KEYS = (Key("program", program_memory),)
"""The key of the table of each node."""


def build_acts(node: Node, added: Mapping[str, Any]) -> list[Callable[[int], None]]:
    """Build the functions that advance a node's programs each tick; empty without programs."""
    if not node.object_dictionary.entries(DATA):
        return []
    values = _read(added["program"] or {})
    memory = MemoryConfig(
        values["largest_bytes"], Checksum(values["checksum"]), round(values["write"] * 1e9)
    )
    return [each.advance for each in program_memories(node.object_dictionary, memory)]


def _read(table: Mapping[str, object]) -> dict[str, Any]:
    problems = Problems("program")
    settings = read_table("", table, PROGRAM_KEYS, problems)
    problems.raise_any()
    return convert(settings, PROGRAM_KEYS)
