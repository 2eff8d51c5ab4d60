"""The feed of work that is no running bench: what is being done, its values, and a stop.

A commissioning, a twin, tests and a campaign have no tick between which they could look for
clients. A thread of its own does that here, ten times a second.
"""

import json
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Self

from hil_bench.abilities.live.messages import (
    ACTED,
    ANSWER,
    COMMAND,
    HEALTH,
    ROW,
    STATE,
    WANTS,
    WANTS_ROWS,
    encode,
)
from hil_bench.abilities.live.process import FeedProcess
from hil_bench.abilities.live.server import FeedPlan
from hil_bench.cli.views import WorkState
from hil_bench.session.commands import Journal

_LOOK = 0.1  # [s]
_STATES = 5  # looks between two states


class WorkFeed:
    """Shows work to those who watch it, as a context manager.

    Args:
        process: of the server.
        plan: that of the server.
        stop: called when somebody asks for the end, in another thread.
    """

    def __init__(self, process: FeedProcess, plan: FeedPlan, stop: Callable[[], None]) -> None:
        self._process = process
        self._plan = plan
        self._stop = stop
        self._lock = threading.Lock()  # two threads write into one ring
        self._over = threading.Event()
        self._served = threading.Event()
        self._wanted = 0
        self._state = WorkState().content()
        self._shown: dict[str, object] | None = None
        self._row: Sequence[float] | None = None
        self._begin = time.monotonic()
        self._time = 0.0
        self._journal = Journal()
        self._looks = 0
        self._thread = threading.Thread(target=self._run, name="hil-bench-work", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        if self._wanted:
            self._publish(is_due=True)
        self._process.stop()

    def wait_for_client(self, timeout: float) -> None:
        """Wait until somebody watches the rows, but no longer than this [s]."""
        self._served.wait(timeout)

    def show(self, state: WorkState) -> None:
        """Show from now on how the work goes."""
        self._state = state.content()

    def put_row(self, values: Sequence[float]) -> None:
        """Show a row: time [s], then a value a channel in its SI unit; any thread but ours."""
        self._time, self._row = values[0], values
        if self._wanted & WANTS_ROWS:
            self._put(ROW, self._plan.row.pack(*values))

    def look(self) -> None:
        """Take requests, and publish what is due."""
        if not self._process.look():
            self._wanted = 0
            return
        for kind, message in self._plan.down.take():
            if kind == WANTS:
                self._shown = None
                self._wanted = message[0]
                if self._wanted & WANTS_ROWS:
                    self._served.set()
            elif kind == COMMAND:
                self._obey(json.loads(message))
        if self._wanted:
            self._looks += 1
            self._publish(is_due=self._shown is None or self._looks % _STATES == 0)

    def _run(self) -> None:
        while not self._over.wait(_LOOK):
            self.look()

    def _publish(self, *, is_due: bool) -> None:
        row = self._row
        if row is not None and not self._wanted & WANTS_ROWS:
            self._put(ROW, self._plan.row.pack(*row))
        now = self._now()
        self._put(HEALTH, encode({"time": now, "lost": self._plan.up.lost}))
        if is_due and self._state != self._shown:
            nothing: dict[str, object] = {"nodes": {}, "ecus": {}, "faults": [], "recording": None}
            state = {"time": now, **nothing, "work": self._state}
            if self._put(STATE, encode(state)):
                self._shown = self._state

    def _now(self) -> float:
        """Return the time of the newest row or, without any, since the beginning [s]."""
        return time.monotonic() - self._begin if self._row is None else self._time

    def _obey(self, content: Mapping[str, Any]) -> None:
        action, ticket = content["do"], content["ticket"]
        answer: dict[str, object] = {"ticket": ticket, "value": None}
        if action == "mark":
            entry = self._journal.add(round(self._now() * 1e9), action, content["fields"])
            self._put(ACTED, encode(entry))
        elif action == "journal":
            answer["value"] = self._journal.content()
        elif action != "stop":
            verb = self._plan.hello["work"]["verb"]
            error = f"{action}: this is {verb}, no running bench; it takes mark, status and stop"
            answer = {"ticket": ticket, "error": error, "kind": "usage"}
        self._put(ANSWER, encode(answer))
        if action == "stop":
            self._stop()

    def _put(self, kind: int, message: bytes) -> bool:
        with self._lock:
            return self._plan.up.put(kind, message)
