"""The feed of a session: rows, frames and events for its watchers, and commands from them.

A session that nobody watches makes no rows for it and keeps no frames: the observers of the feed
come and go with its clients.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from time import monotonic_ns
from typing import TYPE_CHECKING, Any, Protocol, cast, runtime_checkable

from hil_bench.abilities.common.commands import (
    Mark,
    SetObject,
    SetPlant,
    Stop,
)
from hil_bench.abilities.common.shared_ring import pack_frames
from hil_bench.abilities.common.work import WorkState
from hil_bench.abilities.live import messages
from hil_bench.abilities.live.server import FeedPlan, FeedProcess
from hil_bench.ability import load
from hil_bench.bench.commands import (
    Command,
    Controls,
)
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.events import EventWatch
from hil_bench.bench.peers import Peer, peers_of
from hil_bench.bench.session import Session
from hil_bench.canopen_device.datatypes import Value
from hil_bench.canopen_device.frame import Frame
from hil_bench.cli.run_setup import Health
from hil_bench.errors import ConfigError, ControllerError, HilBenchError

if TYPE_CHECKING:
    from concurrent.futures import Future

LOOK = 100_000_000
"""Time between two looks at the bench, and for clients [ns]."""

MOST_AT_ONCE = 4
"""Most commands taken in a tick, so that nobody can hold up the loop by their number."""


@runtime_checkable
class Shown(Protocol):
    """An extension that those who watch the bench see, in keys of its own."""

    def greeting(self) -> Mapping[str, Any]:
        """Return the facts that stay, for those who begin to watch."""

    def state(self, now: int) -> Mapping[str, Any]:
        """Return its present state, at `now` [ns]."""


@dataclass(frozen=True, slots=True)
class GetObject:
    """Read an object of a node, or a signal of a J1939 device; see `SetObject`.

    Attributes:
        node: the name of the node, or of the device.
        name: of the object: "0x6401.01"; or of the signal.
    """

    node: str
    name: str

    def act(self, controls: Controls, now: int) -> Value | None:  # noqa: ARG002 - Command's
        """Return the object's value, None where it has no data; `ConfigError` if unknown."""
        return controls.device(self.node)[self.name]


@dataclass(frozen=True, slots=True)
class ReadJournal:
    """Read which commands have acted."""

    def act(self, controls: Controls, now: int) -> dict[str, object]:  # noqa: ARG002 - Command's
        """Return the entries, and how many older ones are forgotten."""
        return controls.journal.content()


class FeedPart(Protocol):
    """A part of the feed that begins what takes longer than a tick, as a recording.

    Attributes:
        actions: take the fields of a request and return what gets its answer, by the action's name.
    """

    actions: Mapping[str, Callable[[Mapping[str, Any]], "Future[Any]"]]

    def look(self) -> None:
        """Go on with it; called between two ticks."""

    def state(self) -> Mapping[str, Any]:
        """Return its state for those who watch, in a key of its own."""
        ...

    def close(self) -> None:
        """End it with the bench."""


def feed_parts(session: Session, config: BenchConfig, *, is_real_time: bool) -> list[FeedPart]:
    """Return the parts that abilities bring to the feed of a session.

    Args:
        session: what is watched.
        config: of the bench.
        is_real_time: whether ticks must not wait.
    """
    places = dict.fromkeys(each.part for each in messages.added_actions().values() if each.part)
    makers = [cast("Callable[..., FeedPart]", load(place)) for place in places]
    return [make(session, config, is_real_time=is_real_time) for make in makers]


class Feed:
    """A session's end of the feed.

    Args:
        session: what is watched.
        process: of the server.
        plan: that of the server.
        health: asked ten times a second while somebody watches.
        parts: begin what takes longer than a tick.
        work: returns what is played on the bench; None where nothing is.
        clock: says when to look [ns].
    """

    def __init__(
        self,
        session: Session,
        process: FeedProcess,
        plan: FeedPlan,
        *,
        health: Health = dict,
        parts: Sequence[FeedPart] = (),
        work: Callable[[], WorkState] | None = None,
        clock: Callable[[], int] = monotonic_ns,
    ) -> None:
        self._health = health
        self._parts = tuple(parts)
        self._work = work
        self._session = session
        self._events = EventWatch(session.bench)
        self._process = process
        self._plan = plan
        self._put = plan.up.put
        self._pack_row = plan.row.pack
        self._clock = clock
        self._look_at = 0
        self._is_served = False
        self._wanted = 0
        self._shown: dict[str, Any] | None = None

    def look(self) -> None:
        """Take commands, and publish what is due; to be called often, and between two ticks."""
        if self._is_served:
            for kind, message in self._plan.down.take(MOST_AT_ONCE):
                if kind == messages.WANTS:
                    self._want(message[0])
                elif kind == messages.COMMAND:
                    self._obey(json.loads(message))
        for part in self._parts:
            part.look()
        now = self._clock()
        if now < self._look_at:
            return
        self._look_at = now + LOOK
        self._is_served = self._process.look()
        if not self._is_served:
            self._want(0)
        if self._wanted:
            self._publish()

    def stop(self) -> None:
        """Let clients know of the end; what was asked for, as a recording, ends with it."""
        if self._wanted and self._work is not None:
            self._publish()  # with its verdicts
        self._want(0)
        for part in self._parts:
            part.close()
        self._process.stop()

    def _want(self, wanted: int) -> None:
        """Publish what is wanted from now on."""
        changed, self._wanted = wanted ^ self._wanted, wanted
        if changed & messages.WANTS_ROWS:
            change = self._session.watch if wanted & messages.WANTS_ROWS else self._session.unwatch
            change(rows=self._put_row)
        if changed & messages.WANTS_FRAMES:
            change = (
                self._session.watch if wanted & messages.WANTS_FRAMES else self._session.unwatch
            )
            change(frames=self._put_frames)
        if changed & messages.WANTS_STATE:
            self._shown = None
            list(self._events.news())  # before anybody watched
            self._look_at = 0

    def _publish(self) -> None:
        if not self._wanted & messages.WANTS_ROWS:
            self._put_row(self._session.row())
        for event in self._events.news():
            content = {"time": event.time * 1e-9, "what": event.what, **event.content}
            self._put(messages.EVENT, messages.encode(content))
        health = {name: messages.pack_value(value) for name, value in self._health().items()}
        health["time"] = self._session.now * 1e-9
        self._put(messages.HEALTH, messages.encode({**health, "lost": self._plan.up.lost}))
        state = self._state()
        if state != self._shown:
            content = {"time": self._session.now * 1e-9, **state}
            if self._put(messages.STATE, messages.encode(content)):
                self._shown = state

    def _state(self) -> dict[str, Any]:
        session = self._session
        medium = session.bench.medium
        standing = (lambda _device: None) if medium is None else medium.standing
        nodes = {
            name: {
                "state": node.state_name,
                "device": fitting.state() if fitting.state and node.has_power else None,
                "errors": sorted(node.errors),
                **(
                    {"foreign": node.counters.foreign_frames}
                    if node.counters.foreign_frames
                    else {}
                ),
                **({"can": can} if (can := standing(node)) is not None else {}),
            }
            for name, node, fitting in zip(
                session.nodes, session.bench.nodes, session.bench.fittings, strict=True
            )
        }
        ecus = {
            name: _ecu_state(ecu, standing(ecu.ecu))
            for name, ecu in peers_of(session.bench).items()
        }
        state: dict[str, Any] = {"nodes": nodes, "ecus": ecus}
        for each in session.bench.extensions:
            if isinstance(each, Shown):
                state |= each.state(session.now)
        for part in self._parts:
            state |= part.state()
        return state if self._work is None else {**state, "work": self._work().content()}

    def _put_row(self, values: Sequence[float]) -> None:
        self._put(messages.ROW, self._pack_row(*values))

    def _put_frames(self, received: Sequence[Frame], sent: Sequence[Frame], now: int) -> None:
        for frames, is_received in ((received, True), (sent, False)):
            for message in pack_frames(frames, now, is_received=is_received):
                self._put(messages.FRAMES, message)

    def _obey(self, content: Mapping[str, Any]) -> None:
        """Queue a command; it acts at the start of the next tick."""
        answer = partial(self._answer, content)
        try:
            future = self._begin(content["do"], content["fields"])
        except HilBenchError as error:
            self._refuse(content["ticket"], error)
        else:
            future.add_done_callback(answer)

    def _begin(self, action: str, fields: Mapping[str, Any]) -> "Future[Any]":
        """Begin what is asked for, and return what gets the answer.

        Raises:
            ConfigError: nobody may ask for it here.
        """
        added = messages.added_actions().get(action)
        if added is None or not added.part:
            return self._session.door.put(make_command(action, fields))
        for part in self._parts:
            if action in part.actions:
                return part.actions[action](fields)
        raise ConfigError(f"{action}: this bench does not do so on request")

    def _answer(self, content: Mapping[str, Any], future: "Future[Any]") -> None:
        ticket, action = content["ticket"], content["do"]
        if error := future.exception():
            self._refuse(ticket, error)
        else:
            value = messages.pack_value(future.result())
            added = messages.added_actions().get(action)
            if action in _NOTED or (added is not None and added.command):
                journal = self._session.controls.journal
                answer = {added.answer: value} if added is not None and added.answer else {}
                entry = journal.add(self._session.now, action, content["fields"], **answer)
                self._put(messages.ACTED, messages.encode(entry))
            if not self._put(messages.ANSWER, messages.encode({"ticket": ticket, "value": value})):
                self._refuse(ticket, ControllerError("it is done, but its answer is too long"))

    def _refuse(self, ticket: int, error: BaseException) -> None:
        text = (
            str(error) if isinstance(error, HilBenchError) else f"{type(error).__name__}: {error}"
        )
        kind = "usage" if isinstance(error, ConfigError) else "bench"
        self._put(messages.ANSWER, messages.encode({"ticket": ticket, "error": text, "kind": kind}))


def make_command(action: str, fields: Mapping[str, Any]) -> Command:
    """Return the command of a checked request."""
    if added := messages.added_actions().get(action):
        make = cast("Callable[..., Command]", load(added.command))
        return make(**fields)
    return _COMMANDS[action](fields)


_NOTED = frozenset({"set_object", "set_plant", "mark"})
"""Requests that have an entry in the journal when they have acted, beside those of abilities."""

_COMMANDS: Mapping[str, Callable[[Mapping[str, Any]], Command]] = {
    "get_object": lambda got: GetObject(got["node"], got["name"]),
    "set_object": lambda got: SetObject(
        got["node"], got["name"], messages.unpack_value(got["value"])
    ),
    "set_plant": lambda got: SetPlant(got["axis"], got["quantity"], got["value"]),
    "mark": lambda got: Mark(got["text"]),
    "journal": lambda _: ReadJournal(),
    "stop": lambda _: Stop(),
}


def _ecu_state(ecu: Peer, can: Mapping[str, object] | None) -> dict[str, Any]:
    return ecu.standing() if can is None else {**ecu.standing(), "can": can}
