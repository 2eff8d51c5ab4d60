"""A client of a running bench: one connection, in the caller's thread."""

import itertools
import json
import socket
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Self

from hil_bench.abilities.live.messages import check_version, encode, patience, value_of
from hil_bench.abilities.live.places import HAS_SOCKETS, find_names, place_of, where_looked
from hil_bench.errors import BusError, ConfigError, WaitTimeoutError, printable

TIMEOUT = 5.0
"""Longest wait for an answer [s]."""

_MOST_LINE = 1 << 24
_MOST_KEPT = 10_000  # messages that wait while an answer is awaited
_CHUNK = 1 << 16


class BenchEndError(BusError):
    """The bench has ended in order."""


class FeedClient:
    """A connection to a bench, as a context manager.

    Args:
        name: of the bench.
        connection: a connected socket, which the client closes.
        timeout: longest wait for an answer [s].
        clock: says how long that is [s].

    Attributes:
        name: of the bench.
        hello: what the bench says of itself.

    Raises:
        BusError: the bench does not greet, or speaks another version.
    """

    def __init__(
        self,
        name: str,
        connection: socket.socket,
        timeout: float = TIMEOUT,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.name = name
        self._socket = connection
        self._timeout = timeout
        self._clock = clock
        self._buffer = bytearray()
        self._kept: deque[dict[str, Any]] = deque(maxlen=_MOST_KEPT)
        self._numbers = itertools.count(1)
        try:
            self.hello = self._greeting()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the bench."""
        self._socket.close()

    def request(self, action: str, **fields: object) -> Any:  # noqa: ANN401 - what it answers
        """Ask the bench for something and return its answer.

        `ControllerError`: the bench cannot do it. `BusError`: the bench is gone.

        Raises:
            ConfigError: the request is wrong.
            WaitTimeoutError: it does not answer, since its time stands still.
        """
        number = next(self._numbers)
        try:
            line = encode({"id": number, "do": action, **fields})
        except (TypeError, ValueError):
            sent = ", ".join(f"{name} = {value}" for name, value in fields.items())
            raise ConfigError(
                printable(f"{action}: {sent}: give finite numbers and texts")
            ) from None
        self._send(line)
        timeout = patience(action, self._timeout)
        deadline = self._clock() + timeout
        while True:
            message = self._read(deadline - self._clock())
            if message is None:
                raise WaitTimeoutError(
                    f"bench {self.name}: no answer in {timeout:g} s; its time stands still, "
                    "or it is too busy"
                )
            if message.get("type") != "answer" or message.get("id") not in {number, None}:
                self._kept.append(message)
            else:
                return value_of(message)

    def receive(self, timeout: float) -> dict[str, Any] | None:
        """Return the next message that is no answer; None where none comes in time [s].

        `BenchEndError`: the bench has ended; another `BusError`: it is gone.
        """
        return self._kept.popleft() if self._kept else self._read(timeout)

    def _greeting(self) -> dict[str, Any]:
        message = self._read(self._timeout)
        if message is None:
            raise WaitTimeoutError(f"bench {self.name}: no greeting in {self._timeout:g} s")
        check_version(self.name, message)
        return message

    def _send(self, line: bytes) -> None:
        try:
            self._socket.settimeout(self._timeout)
            self._socket.sendall(line)
        except OSError as error:
            raise self._gone() from error

    def _read(self, timeout: float) -> dict[str, Any] | None:
        """Return the next message; None where none comes in time [s].

        Raises:
            BusError: the bench is gone.
        """
        deadline = self._clock() + timeout
        searched = 0
        while (end := self._buffer.find(b"\n", searched)) < 0:
            searched = len(self._buffer)
            if searched > _MOST_LINE:
                raise BusError(f"bench {self.name}: a message without an end")
            remaining = deadline - self._clock()
            if remaining <= 0:
                return None
            try:
                self._socket.settimeout(remaining)
                chunk = self._socket.recv(_CHUNK)
            except TimeoutError:
                return None
            except OSError as error:
                raise self._gone() from error
            if not chunk:
                raise self._gone()
            self._buffer += chunk
        line = bytes(self._buffer[:end])
        del self._buffer[: end + 1]
        return self._checked(line)

    def _checked(self, line: bytes) -> dict[str, Any]:
        try:
            message = json.loads(line)
        except (ValueError, RecursionError):
            message = None
        if not isinstance(message, dict):
            raise BusError(f"bench {self.name}: its message is not a JSON object")
        if message.get("type") == "error":
            raise BusError(f"bench {self.name}: {printable(str(message.get('error')))}")
        if message.get("type") == "end":
            raise BenchEndError(f"bench {self.name}: it has ended")
        return message

    def _gone(self) -> BusError:
        return BusError(f"bench {self.name}: the connection is lost")


def connect(name: str | None = None, timeout: float = TIMEOUT) -> FeedClient:
    """Connect to a running bench.

    Args:
        name: of the bench; not needed where only one runs.
        timeout: longest wait for an answer [s].

    Raises:
        BusError: there is no such bench, or no bench at all; `ConfigError` where several run, and
            none is named.
    """
    if not HAS_SOCKETS:
        raise BusError("this machine has no Unix sockets, by which a running bench is watched")
    if name is None:
        name = only_one(find_names())
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        connection.settimeout(timeout)
        connection.connect(str(place_of(name)))
    except (FileNotFoundError, ConnectionRefusedError) as error:
        connection.close()
        raise BusError(f'no bench with the name "{name}" runs ({where_looked()})') from error
    except OSError as error:
        connection.close()
        raise BusError(f"bench {name}: {error.strerror or error}") from error
    return FeedClient(name, connection, timeout)


def only_one(names: Sequence[str]) -> str:
    """Return the one name.

    Raises:
        BusError: there is none.
        ConfigError: there are several.
    """
    if not names:
        raise BusError(f"no bench runs; start one with hil-bench run ({where_looked()})")
    if len(names) > 1:
        raise ConfigError(f"{len(names)} benches run; name one of {', '.join(names)}")
    return names[0]
