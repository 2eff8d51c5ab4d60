"""The commands that have acted on a bench: enough to do the same again, as a scenario does."""

import json
from collections import deque
from collections.abc import Mapping
from typing import Any

MOST_ENTRY = 4096
"""Longest entry [byte]; a longer one, such as one with a large object, is kept without values."""

MOST_BYTES = 1 << 18
"""Most bytes of all entries; beyond, the oldest are forgotten."""

ACTIONS = frozenset({"begin_fault", "clear_fault", "set_object", "set_plant", "mark"})
"""Requests that have an entry when they have acted."""


class Journal:
    """The record of the commands that have acted, the oldest first."""

    def __init__(self) -> None:
        self._entries: deque[tuple[dict[str, Any], int]] = deque()
        self._bytes = self._count = 0

    def add(
        self, now: int, action: str, fields: Mapping[str, Any], value: object
    ) -> dict[str, Any]:
        """Note a command that has acted.

        Args:
            now: the tick in which it acted [ns].
            action: as in its request.
            fields: likewise.
            value: its answer.

        Returns:
            The entry.
        """
        self._count += 1
        entry = {"entry": self._count, "time": now * 1e-9, "do": action, "fields": dict(fields)}
        if action == "begin_fault":
            entry["number"] = value
        size = len(json.dumps(entry))
        if size > MOST_ENTRY:
            entry["fields"], size = {}, MOST_ENTRY
        self._entries.append((entry, size))
        self._bytes += size
        while self._bytes > MOST_BYTES:
            _, size = self._entries.popleft()
            self._bytes -= size
        return entry

    def content(self) -> dict[str, object]:
        """Return the entries, and how many older ones are forgotten."""
        entries = [entry for entry, _ in self._entries]
        return {"entries": entries, "forgotten": self._count - len(entries)}
