"""The middle of a panel: one connection to the bench, any number of browsers.

What the bench says goes to every browser as it is, bundled thirty times a second. Nobody looks: the
bench is asked for no rows and no frames.
"""

import asyncio
import contextlib
import itertools
import json
from collections import deque
from typing import Any

from hil_bench.abilities.panel.bench_link import BenchLink, open_link
from hil_bench.abilities.panel.bus_findings import BusFindings
from hil_bench.abilities.panel.fault_table import fault_choices
from hil_bench.abilities.panel.frame_news import FrameNews
from hil_bench.abilities.panel.viewer import Viewer
from hil_bench.errors import BusError, ConfigError, HilBenchError
from hil_bench.outside.feed.client import only_one
from hil_bench.outside.feed.messages import encode
from hil_bench.outside.feed.places import find_names
from hil_bench.shown_units import units_content

MOST_VIEWERS = 64

BEAT = 1 / 30
"""Time between two bundles [s]."""

RETRY = 0.5
"""Time between two looks for a bench [s]."""

_MOST_EVENTS = 500
_LOOK = 30  # beats between two looks which benches run


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
        """Look again at what browsers want."""
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
            await self._change.wait()

    async def _beat(self) -> None:
        """Send bundles, one for all browsers."""
        for beat in itertools.count():
            await asyncio.sleep(BEAT)
            if self.viewers and self.link is not None and beat % _LOOK == 0:
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
            self._findings = BusFindings(hello.get("devices", {}))
        try:
            message = self._findings.take(json.loads(line)["frames"])
        except (ValueError, TypeError, KeyError, RecursionError):
            raise BusError("the bench's message of frames is not one") from None
        if message is not None:
            for viewer in self.viewers:
                if viewer.wants_frames:
                    viewer.offer(encode(message))

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
