"""The hub between feeds and browsers: viewers, news of frames, findings on buses."""

import asyncio
import contextlib
import itertools
import json
from collections import deque
from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

from hil_bench.abilities.common.shown_units import units_content
from hil_bench.abilities.eyes.explain.explain import Explainer, LiveFindings
from hil_bench.abilities.eyes.explain.finding import Finding
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.abilities.live.client import only_one
from hil_bench.abilities.live.messages import encode
from hil_bench.abilities.live.places import find_names
from hil_bench.abilities.panel.bench_link import BenchLink, fault_choices, open_link
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import BusError, ConfigError, HilBenchError
from hil_bench.outside.bits import USUAL_BITRATE
from hil_bench.outside.recording.channels import LoggedFrame

# A browser that looks at a panel: what waits for it, and what it has lost.

MOST_UNREAD = 1 << 20
"""Bytes that may wait for a browser; beyond, it loses rows, frames and events."""

MOST_WAITING = 1 << 22
"""Bytes of all that may wait for a browser; beyond, it is given up."""

Send = Callable[[bytes], Awaitable[None]]
"""Sends a message to the browser; it returns when there is room for the next one."""


class Viewer:
    """One browser.

    Args:
        send: to it.

    Attributes:
        wants_frames: whether it shows frames.
        wants_marks: whether it marks the frames that are news.
        lost: messages that it has lost since the last time it was told.
        over: set when it is given up.
    """

    def __init__(self, send: Send) -> None:
        self.wants_frames = False
        self.wants_marks = False
        self.lost = 0
        self.over = asyncio.Event()
        self._send = send
        self._waiting: list[bytes] = []
        self._size = 0
        self._wake = asyncio.Event()

    def offer(self, lines: bytes) -> None:
        """Send it lines that it may lose."""
        if self.is_slow:
            self.lost += lines.count(b"\n")
        else:
            self.tell(lines)

    def tell(self, lines: bytes) -> None:
        """Send it lines that it must have."""
        self._waiting.append(lines)
        self._size += len(lines)
        self._wake.set()
        if self._size > MOST_WAITING:
            self.over.set()

    @property
    def is_slow(self) -> bool:
        """Return True if it has to read before it gets more."""
        return self._size > MOST_UNREAD

    async def pump(self) -> None:
        """Send what waits, for ever."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            if self.lost:
                self._waiting.insert(0, encode({"type": "missed", "messages": self.lost}))
                self.lost = 0
            lines, self._waiting = b"".join(self._waiting), []
            await self._send(lines)
            self._size = sum(map(len, self._waiting))


# The frames of a bus that a scope marks: EMCY, NMT commands, heartbeats with another state.

_NMT, _EMCY, _HEARTBEAT = 0x000, range(0x081, 0x100), range(0x701, 0x780)
_MOST_AT_ONCE = 50


class FrameNews:
    """Picks the frames that are news: of a heartbeat, only those with another state."""

    def __init__(self) -> None:
        self._states: dict[tuple[int, int], str] = {}

    def take(self, frames: Sequence[Sequence[Any]]) -> list[Sequence[Any]]:
        """Return those of some frames that are news, the newest of a flood.

        Args:
            frames: as the feed has them: time, bus, way, identifier, data, extended, remote,
                CAN FD.
        """
        return [*self._news(frames)][-_MOST_AT_ONCE:]

    def _news(self, frames: Sequence[Sequence[Any]]) -> Iterator[Sequence[Any]]:
        for frame in frames:
            _, bus, _, identifier, data, is_extended, is_remote, fd = frame
            if is_extended or is_remote or fd:
                continue
            if identifier == _NMT or identifier in _EMCY:
                yield frame
            elif identifier in _HEARTBEAT:
                before = self._states.get((bus, identifier))
                self._states[bus, identifier] = data
                if before is not None and before != data:
                    yield frame


# Faults on the buses of a bench, as `explain` names them, for the page's view of the bus.

_NS: Final = 1_000_000_000
_MOST_BUSES: Final = 64
_MOST: Final = 20
"""Findings of a bus that are shown."""


class BusFindings:
    """Explains each bus from the frame on at which somebody begins to look.

    Args:
        devices: of the bench, as its greeting has them: node-ID and bus by name.
        rates: of each bus, likewise: its bit rate [bit/s], and how many times faster the data phase
            of CAN FD is.
    """

    def __init__(self, devices: Mapping[str, Any], rates: Sequence[Sequence[float]] = ()) -> None:
        self._devices = devices
        self._rates = rates
        self._buses: dict[int, tuple[Explainer, LiveFindings, float]] = {}

    def take(self, frames: Iterable[Sequence[Any]]) -> dict[str, Any] | None:
        """Take frames; return the message of what is wrong where that has changed.

        Args:
            frames: as the feed has them: time, bus, way, identifier, data, extended, remote,
                CAN FD.
        """
        is_news = False
        for time, bus, _way, can_id, data, is_extended, is_remote, fd in frames:
            if bus not in self._buses and len(self._buses) >= _MOST_BUSES:
                continue
            explainer, live, _ = self._buses.get(bus) or self._begin(bus, time)
            payload = bytes.fromhex(data)
            frame = Frame(can_id, payload, bool(is_remote), bool(is_extended), fd=fd)
            explainer.take(LoggedFrame(frame, round(time * _NS), None))
            is_news |= any([*live.look(explainer.now)])
        return self.message() if is_news else None

    def _begin(self, bus: int, time: float) -> tuple[Explainer, LiveFindings, float]:
        known = [
            KnownNode(each["node_id"], name)
            for name, each in self._devices.items()
            if each.get("bus") == bus and each.get("node_id")
        ]
        bitrate, speedup = self._rates[bus] if bus < len(self._rates) else (USUAL_BITRATE, 1.0)
        explainer = Explainer(known, int(bitrate), speedup=speedup)
        self._buses[bus] = explainer, LiveFindings(explainer), time
        return self._buses[bus]

    def message(self) -> dict[str, Any]:
        """Return the findings of all buses, and the bench time from which those of each count."""
        return {
            "type": "findings",
            "findings": [
                {**_content(bus, finding), "since": begin}
                for bus, (_, live, begin) in sorted(self._buses.items())
                for finding in live.findings[:_MOST]
            ],
        }


def _content(bus: int, finding: Finding) -> dict[str, Any]:
    return {
        "bus": bus,
        "title": finding.cause.title,
        "clause": finding.cause.clause,
        "text": finding.text,
        "advice": finding.cause.advice,
        "leads_to": [each.text for each in finding.consequences[:_MOST]],
    }


# The middle of a panel: one connection to the bench, any number of browsers.
#
# What the bench says goes to every browser as it is, bundled thirty times a second. Nobody looks:
# the bench is asked for no rows and no frames.

MOST_VIEWERS = 64

BEAT = 1 / 30
"""Time between two bundles [s]."""

RETRY = 0.5
"""Time between two looks for a bench [s]."""

_MOST_EVENTS = 500
_LOOK = 30  # beats between two looks which benches run
_BEAT = encode({"type": "beat"})  # without it, a page knows that nothing on it is live


class Hub:
    """Connects browsers with a bench, and waits for it where it is not there.

    Args:
        name: of the bench; None for the one that runs.
        seats: most browsers.

    Attributes:
        link: the bench; None while there is none.
        viewers: the browsers.
        visited: how many benches have been there.
    """

    def __init__(self, name: str | None = None, seats: int = MOST_VIEWERS) -> None:
        self.link: BenchLink | None = None
        self.viewers: list[Viewer] = []
        self.visited = 0
        self._seats = seats
        self._wanted = name
        self._ending = ""  # of the bench that was there last
        self._status: dict[str, Any] = {"type": "panel", "bench": None, "words": "", "benches": []}
        self._state = self._health = b""
        self._events: deque[bytes] = deque(maxlen=_MOST_EVENTS)
        self._rows: list[bytes] = []
        self._frames: list[bytes] = []
        self._news = FrameNews()
        self._findings: BusFindings | None = None
        self._watched: tuple[bool, bool] | None = None
        self._change = asyncio.Event()

    @property
    def bench(self) -> BenchLink:
        """The bench.

        Raises:
            BusError: there is none at present.
        """
        if self.link is None:
            raise BusError("no bench is connected at present; it acts on nothing")
        return self.link

    def admit(self, viewer: Viewer) -> None:
        """Take a browser, and show it how things are.

        Raises:
            BusError: there are too many.
        """
        if len(self.viewers) >= self._seats:
            raise BusError(f"{self._seats} browsers look at this panel already; close one")
        self.viewers.append(viewer)
        viewer.tell(encode(self._status) + self._greeting())
        self._change.set()

    def leave(self, viewer: Viewer) -> None:
        """Forget a browser."""
        if viewer in self.viewers:
            self.viewers.remove(viewer)
            self._change.set()

    def review(self) -> None:
        """Look again at what browsers want; one that begins to show frames sees what is wrong."""
        if self._findings is not None:
            self._show_findings(self._findings.message())
        self._change.set()

    def choose(self, name: str) -> None:
        """Look at another bench from now on.

        Raises:
            ConfigError: no such bench runs.
        """
        names = find_names()
        if name not in names:
            raise ConfigError(f"bench {name!a} does not run; give one of {', '.join(names)}")
        self._wanted = name
        if self.link is not None and self.link.name != name:
            self.link.close()
        self._change.set()

    async def run(self, *, is_once: bool = False) -> None:
        """Look for a bench and show it, for ever.

        Args:
            is_once: whether to end with the first bench.

        Raises:
            BusError: it is to end with a bench that does not run, so that there is no end to see.
        """
        beat = asyncio.create_task(self._beat())
        try:
            while not (is_once and self.visited):
                if is_once and self._wanted is not None and self._wanted not in find_names():
                    raise BusError(f"bench {self._wanted} does not run; the panel ends with it")
                await self._visit()
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(RETRY):
                        await self._change.wait()
                self._change.clear()
        finally:
            beat.cancel()

    async def _visit(self) -> None:
        names = find_names()
        try:
            link = await open_link(self._wanted or only_one(names))
        except BusError as error:
            self._say(None, self._ending or str(error), names)
            return
        except HilBenchError as error:
            self._say(None, str(error), names)
            return
        async with link:
            self.link, self._watched, self._news = link, None, FrameNews()
            self._findings = None
            self.visited += 1
            self._say(link.name, "", names)
            self._to_all(self._greeting())
            care = asyncio.create_task(self._care(link))
            ending = f"bench {link.name} is gone"
            try:
                await link.listen(self._take)
            except HilBenchError as error:
                ending = str(error)
            finally:
                care.cancel()
                self._forget()
        self._ending = f"{ending}; the page goes on when it runs again"
        self._say(None, self._ending, find_names())

    def _forget(self) -> None:
        self.link = None
        self._state = self._health = b""
        self._rows, self._frames = [], []
        self._events.clear()

    async def _care(self, link: BenchLink) -> None:
        """Ask the bench for what browsers want, whenever that changes."""
        while True:
            self._change.clear()  # before the look, so that none in between is missed
            shows = any(viewer.wants_frames or viewer.wants_marks for viewer in self.viewers)
            wanted = bool(self.viewers), shows
            if wanted != self._watched:
                rows = 0.0 if wanted[0] else None
                try:
                    await link.request("watch", rows_every_s=rows, frames=wanted[1])
                except HilBenchError:
                    await asyncio.sleep(RETRY)
                    continue
                self._watched = wanted
                if not shows:
                    self._findings = None  # what nobody asked for, nobody was late with
            await self._change.wait()

    async def _beat(self) -> None:
        """Send bundles, one for all browsers."""
        for beat in itertools.count():
            await asyncio.sleep(BEAT)
            if self.viewers and beat % _LOOK == 0:
                self._to_all(_BEAT)
                if self.link is not None:
                    self._say(self.link.name, "", find_names())
            if self._rows:
                lines, self._rows = b"".join(self._rows), []
                self._to_all(lines, may_be_lost=True)
            if self._frames:
                lines, self._frames = b"".join(self._frames), []
                for viewer in self.viewers:
                    if viewer.wants_frames:
                        viewer.offer(lines)

    def _take(self, kind: str, line: bytes, _content: dict[str, Any]) -> None:
        if not self.viewers and kind in {"rows", "frames"}:
            return
        if kind == "rows":
            self._rows.append(line)
        elif kind == "frames":
            if any(viewer.wants_frames for viewer in self.viewers):
                self._frames.append(line)
                self._explain(line)
            else:
                self._findings = None
            if any(viewer.wants_marks for viewer in self.viewers):
                self._mark(line)
        else:
            if kind == "state":
                self._state = line
            elif kind == "health":
                self._health = line
            elif kind == "lost":
                self._findings = None  # what it has not heard, nobody was late with
            elif kind in {"event", "command"}:
                self._events.append(line)
            self._to_all(line, may_be_lost=kind == "health")

    def _explain(self, line: bytes) -> None:
        """Show what is wrong on the buses to the browsers that show frames.

        Raises:
            BusError: the bench's message is not what frames are.
        """
        if self._findings is None:
            hello = {} if self.link is None else self.link.hello
            self._findings = BusFindings(hello.get("devices", {}), hello.get("bus_rates", ()))
        try:
            message = self._findings.take(json.loads(line)["frames"])
        except (ValueError, TypeError, LookupError, ArithmeticError, RecursionError):
            raise BusError("the bench's message of frames is not one") from None
        if message is not None:
            self._show_findings(message)

    def _show_findings(self, message: dict[str, Any]) -> None:
        line = encode(message)
        for viewer in self.viewers:
            if viewer.wants_frames:
                viewer.offer(line)

    def _mark(self, line: bytes) -> None:
        """Show the frames that are news to the browsers that mark them.

        Raises:
            BusError: the bench's message is not what frames are.
        """
        try:
            frames = self._news.take(json.loads(line)["frames"])
        except (ValueError, TypeError, KeyError, RecursionError):
            raise BusError("the bench's message of frames is not one") from None
        if frames:
            line = encode({"type": "frame_marks", "frames": frames})
            for viewer in self.viewers:
                if viewer.wants_marks:
                    viewer.offer(line)

    def _to_all(self, lines: bytes, *, may_be_lost: bool = False) -> None:
        for viewer in self.viewers:
            if may_be_lost:
                viewer.offer(lines)
            else:
                viewer.tell(lines)

    def _greeting(self) -> bytes:
        if self.link is None:
            return b""
        hello = {**self.link.hello, "fault_kinds": fault_choices(self.link.hello)}
        hello["units"] = units_content()
        return b"".join([encode(hello), self._state, self._health, *self._events])

    def _say(self, bench: str | None, words: str, benches: list[str]) -> None:
        status = {"type": "panel", "bench": bench, "words": words, "benches": benches}
        if status != self._status:
            self._status = status
            self._to_all(encode(status))
