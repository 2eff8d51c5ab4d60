"""The commands that a running bench accepts: their door, and the journal of those that acted."""

import json
import threading
from collections import deque
from collections.abc import Mapping
from concurrent.futures import Future
from typing import Any, Protocol

from hil_bench.bench.bench import Bench
from hil_bench.canopen_device.datatypes import Value
from hil_bench.errors import ConfigError, ControllerError

# The commands that have acted on a bench: enough to do the same again, as a scenario does.

MOST_ENTRY = 4096
"""Longest entry [byte]; a longer one, such as one with a large object, is kept without values."""

MOST_BYTES = 1 << 18
"""Most bytes of all entries; beyond, the oldest are forgotten."""


class Journal:
    """The record of the commands that have acted, the oldest first."""

    def __init__(self) -> None:
        self._entries: deque[tuple[dict[str, Any], int]] = deque()
        self._bytes = self._count = 0

    def add(
        self, now: int, action: str, fields: Mapping[str, Any], **answer: object
    ) -> dict[str, Any]:
        """Note a command that has acted.

        Args:
            now: the tick in which it acted [ns].
            action: as in its request.
            fields: likewise.
            answer: what else its entry has.

        Returns:
            The entry.
        """
        self._count += 1
        entry = {"entry": self._count, "time": now * 1e-9, "do": action, "fields": dict(fields)}
        entry |= answer
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


# The commands that a running bench accepts through its door.
#
# Each command is a record of plain values, so that it can come from another process.


class Device(Protocol):
    """A device with values that a command may read and set, by name."""

    def __getitem__(self, name: str, /) -> Value | None:
        """Return a value; `ConfigError` where there is none of that name."""

    def __setitem__(self, name: str, value: Any, /) -> None:  # noqa: ANN401 - checked there
        """Set a value; `ConfigError` where it cannot be."""


class Controls:
    """The parts of a bench that commands act on.

    Args:
        bench: the bench.
        devices: its devices by their names.

    Attributes:
        bench: as passed in.
        devices: as passed in.
        journal: the commands that have acted.
        is_over: whether a command has asked for the end of the run.
    """

    def __init__(self, bench: Bench, devices: Mapping[str, Device]) -> None:
        self.bench = bench
        self.devices = devices
        self.journal = Journal()
        self.is_over = False

    def device(self, name: str) -> Device:
        """Return a device.

        Raises:
            ConfigError: there is none of this name.
        """
        if name not in self.devices:
            known = f"give one of {', '.join(self.devices)}" if self.devices else "there is none"
            raise ConfigError(f'nodes: there is no node "{name}"; {known}')
        return self.devices[name]


class Command(Protocol):
    """Something to do at the start of a tick."""

    def act(self, controls: Controls, now: int) -> object:
        """Do it at `now` [ns] and return the answer; any exception is the answer of a failure."""


# The door of a running bench: commands queue here and act at the start of the next tick.
#
# The order of the queue is the order in which they act, and each gets an answer or an error. So a
# run with the same commands before the same ticks is the same run.

MOST_WAITING = 1000
"""Most commands that wait for one tick."""


class Door:
    """Takes commands from any thread; one thread, that of the bench, lets them act.

    Args:
        controls: what the commands act on.

    Attributes:
        waiting: commands and where their answers go, the oldest first.
    """

    def __init__(self, controls: Controls) -> None:
        self._controls = controls
        self.waiting: deque[tuple[Command, Future[Any]]] = deque()
        self._lock = threading.Lock()
        self._is_open = True

    def put(self, command: Command) -> "Future[Any]":
        """Queue a command.

        Returns:
            What gets its answer, or the error that ended it, in the next tick. Until then it can be
            cancelled. Who waits for it in the thread of the bench waits for ever.

        Raises:
            ControllerError: the bench has ended, or too many commands wait.
        """
        with self._lock:
            if not self._is_open:
                raise ControllerError("the bench has ended; it takes no more commands")
            if len(self.waiting) >= MOST_WAITING:
                raise ControllerError(
                    f"{MOST_WAITING} commands wait for the next tick already; wait for an answer"
                )
            answer: Future[Any] = Future()
            self.waiting.append((command, answer))
        return answer

    def admit(self, now: int) -> None:
        """Let the commands that wait act, the oldest first.

        Args:
            now: bench time of the tick that begins [ns].
        """
        for _ in range(len(self.waiting)):
            command, answer = self.waiting.popleft()
            if not answer.set_running_or_notify_cancel():
                continue
            try:
                result = command.act(self._controls, now)
            except Exception as error:  # whatever it is, the bench goes on
                answer.set_exception(error)
            else:
                answer.set_result(result)

    def close(self) -> None:
        """Take no more commands; those that wait get an error."""
        with self._lock:
            self._is_open = False
        while self.waiting:
            _, answer = self.waiting.popleft()
            if answer.set_running_or_notify_cancel():
                answer.set_exception(ControllerError("the bench ended before its next tick"))
