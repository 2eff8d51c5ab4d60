"""The link of the panel to a bench, and the faults that it offers."""

import asyncio
import contextlib
import itertools
import json
from collections.abc import Callable, Mapping
from typing import Any, Self

from hil_bench.abilities.faults.kind import FaultKind
from hil_bench.abilities.faults.live import fault_keys
from hil_bench.abilities.faults.registry import LASTS_KEY, all_kinds
from hil_bench.abilities.live.client import TIMEOUT
from hil_bench.abilities.live.messages import check_version, encode, patience, value_of
from hil_bench.abilities.live.places import HAS_SOCKETS, place_of, where_looked
from hil_bench.config.settings import Key
from hil_bench.config.values import choice
from hil_bench.errors import BusError, WaitTimeoutError, printable

# A connection to the feed of a bench in asyncio: what arrives, and requests with their answers.

_MOST_LINE = 1 << 24
_ROWS, _FRAMES = b'{"type":"rows"', b'{"type":"frames"'

Take = Callable[[str, bytes, dict[str, Any]], None]
"""Given the type of a message, its line, and its content where it is neither rows nor frames."""


class BenchLink:
    """A bench, as a context manager.

    Args:
        name: of the bench.
        reader: of its socket.
        writer: likewise.
        timeout: longest wait for an answer [s].

    Attributes:
        name: as passed in.
        hello: what the bench says of itself.
    """

    def __init__(
        self,
        name: str,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        timeout: float = TIMEOUT,
    ) -> None:
        self.name = name
        self.hello: dict[str, Any] = {}
        self._reader = reader
        self._writer = writer
        self._timeout = timeout
        self._numbers = itertools.count(1)
        self._open: dict[int, asyncio.Future[Any]] = {}

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the bench; requests without an answer fail."""
        self._writer.close()
        waiting, self._open = self._open, {}
        for future in waiting.values():
            if not future.done():
                future.set_exception(BusError(f"bench {self.name}: the connection is lost"))

    async def greet(self) -> None:
        """Hear who it is.

        Raises:
            BusError: it is none, or speaks another version.
            WaitTimeoutError: it says nothing.
        """
        try:
            async with asyncio.timeout(self._timeout):
                self.hello = json.loads(await self._line())
        except TimeoutError:
            raise WaitTimeoutError(f"bench {self.name}: no greeting") from None
        except ValueError:
            raise BusError(f"bench {self.name}: its greeting is not JSON") from None
        if self.hello.get("type") == "error":
            raise BusError(f"bench {self.name}: {printable(str(self.hello.get('error')))}")
        check_version(self.name, self.hello)

    async def request(self, action: str, **fields: object) -> Any:  # noqa: ANN401 - what it answers
        """Ask the bench for something and return its answer.

        `ConfigError`: the request is wrong. `ControllerError`: the bench cannot do it.

        Raises:
            WaitTimeoutError: it does not answer, since its time stands still.
        """
        number = next(self._numbers)
        future: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        self._open[number] = future
        timeout = patience(action, self._timeout)
        self._writer.write(encode({"id": number, "do": action, **fields}))
        try:
            async with asyncio.timeout(timeout):
                answer = await future
        except TimeoutError:
            raise WaitTimeoutError(
                f"no answer in {timeout:g} s; the bench's time stands still, or it is too "
                "busy. The command acts when time goes on"
            ) from None
        finally:
            self._open.pop(number, None)
        return value_of(answer)

    async def listen(self, take: Take) -> None:
        """Pass on what the bench says, until a `BusError` tells that it is gone."""
        while True:
            line = await self._line()
            if line.startswith(_ROWS):
                take("rows", line, {})
            elif line.startswith(_FRAMES):
                take("frames", line, {})
            else:
                self._sort(line, take)

    def _sort(self, line: bytes, take: Take) -> None:
        """Pass on a message, or wake up who waits for it as an answer.

        Raises:
            BusError: it is not one, or the last one.
        """
        try:
            message = json.loads(line)
            kind = message["type"]
        except (ValueError, TypeError, KeyError, RecursionError):
            raise BusError(f"bench {self.name}: its message is not a JSON object") from None
        if kind == "answer":
            future = self._open.get(message.get("id"))
            if future is not None and not future.done():
                future.set_result(message)
        elif kind == "end":
            raise BusError(f"bench {self.name} has ended")
        else:
            take(str(kind), line, message)

    async def _line(self) -> bytes:
        try:
            line = await self._reader.readline()
        except (OSError, ValueError) as error:
            raise BusError(f"bench {self.name}: the connection is lost") from error
        if not line.endswith(b"\n"):
            raise BusError(f"bench {self.name}: the connection is lost")
        return line


async def open_link(name: str) -> BenchLink:
    """Connect to a running bench and hear its greeting.

    Raises:
        BusError: there is no such bench.
    """
    if not HAS_SOCKETS:
        raise BusError("this machine has no Unix sockets, by which a running bench is watched")
    try:
        async with asyncio.timeout(TIMEOUT):
            reader, writer = await asyncio.open_unix_connection(
                str(place_of(name)), limit=_MOST_LINE
            )
    except (FileNotFoundError, ConnectionRefusedError):
        raise BusError(f'no bench with the name "{name}" runs ({where_looked()})') from None
    except OSError as error:
        raise BusError(f"bench {name}: {error.strerror or error}") from error
    link = BenchLink(name, reader, writer)
    with contextlib.ExitStack() as stack:
        stack.callback(link.close)
        await link.greet()
        stack.pop_all()
    return link


# The faults that a page offers: each kind with its targets and their keys.


def fault_choices(hello: Mapping[str, Any]) -> dict[str, dict[str, list[dict[str, object]]]]:
    """Return the keys of each kind of fault that a bench can have, by kind and target.

    Args:
        hello: what the bench says of itself.
    """
    return {
        kind.name: {
            target: [_content(kind, key) for key in (*fault_keys(kind, target, hello), LASTS_KEY)]
            for target in kind.find_targets(hello.get("fault_targets", {}))[1]
            if _can_have(kind, target, hello)
        }
        for kind in all_kinds()
    }


def _can_have(kind: FaultKind, target: str, hello: Mapping[str, Any]) -> bool:
    """Return False if a kind is a defect that the plant or supply has not declared."""
    declared = hello.get("defects", {}).get(target)
    defects = kind.defects.values()
    return declared is None or not defects or any(name in declared for name in defects)


def _content(kind: FaultKind, key: Key) -> dict[str, object]:
    default = key.default if key.default is not None else key.example
    return {
        "name": key.name,
        "words": kind.word(key),
        "unit": key.unit.symbol,
        "default": None if key is LASTS_KEY else default,
        "is_needed": bool(key.example),
        "choices": [*key.read.words] if isinstance(key.read, choice) else None,
    }
