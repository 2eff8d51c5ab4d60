"""The controller's end of a bus whose bench is in lock-step: it lets time pass, SYNC by SYNC.

A tick sends what the controller has to say, a SYNC, and an SDO request to one of the nodes. The
bench takes frames in the order of the bus and answers each before it looks at the next, so the
answer to that request, the end mark, comes after all that the SYNC brings. No clock is asked but
to give up.

The request is for the number of entries of 0x1018, which every device has (CiA 301) and nobody
else asks for, so no answer is mistaken for one to the controller.
"""

import time
from collections.abc import Callable, Iterable, Sequence

import can

from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.sync import SYNC_COB_ID
from hil_bench.errors import BusError
from hil_bench.outside.transports.transport import FRAMES_AT_ONCE, Transport

START_TIMEOUT = 10.0
"""Longest wait for the first answer [s]: the bench may just be starting."""

ANSWER_TIMEOUT = 2.0
"""Longest wait for an end mark [s], however busy the bench's machine is."""

QUIET = 0.3
"""Time without a frame that shows that nothing happens by itself [s]."""

MOST_ASKED = 3
"""Nodes that are asked for one end mark, one after the other, before the bench is given up."""

_SYNC = Frame(SYNC_COB_ID)
_SDO_REQUEST, _SDO_ANSWER, _HEARTBEAT = 0x600, 0x580, 0x700
_REQUEST = bytes.fromhex("4018100000000000")


class _LockStepError(Exception):
    """The bench is gone, or not in lock-step."""


class LockStepController:
    """The controller's side of lock-step: it moves the bench by SYNC and waits for the end marks.

    Its `tick` is one that `EmbeddedBus` takes, so a controller waits as in front of a bench in its
    own process, and nothing depends on how fast the two processes are.

    Args:
        transport: the bus; it stays the caller's.
        node_ids: nodes that may be asked for the end mark, by their default SDO server.
        clock: what the time-outs are counted on [s].
    """

    def __init__(
        self,
        transport: Transport,
        node_ids: Iterable[int],
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._transport = transport
        self._clock = clock
        self._node_ids = list(node_ids)
        self._asked: set[int] = set()
        self._answered: set[int] = set()
        self._brought: list[Frame] = []
        self._busy: int | None = None
        self._is_interrupted = False
        self._has_heard_heartbeat = False

    def join(self) -> None:
        """Find out which nodes answer, and that nothing happens by itself.

        Raises:
            BusError: fewer than two answer, or time passes without SYNC.
        """
        try:
            self._find_nodes()
        except _LockStepError as error:
            raise BusError(f"{self._transport.description}: {error}") from error
        nodes = self._node_ids = [node for node in self._node_ids if node in self._answered]
        # A second node stands in where the first is in the middle of the controller's own transfer.
        if len(nodes) < 2:
            told = f"only node {nodes[0]} answers" if nodes else "no node answers"
            raise BusError(
                f"{self._transport.description}: {told}; lock-step needs two, of a "
                "'hil-bench run --lockstep' on this bus"
            )

    def tick(self, frames: Sequence[Frame], now: int) -> list[Frame]:  # noqa: ARG002 - of the bus
        """Send the controller's frames and a SYNC; return all that the bench says to them.

        A SYNC among the frames is this SYNC.

        Raises:
            can.CanOperationError: the bench is gone, or not in lock-step.
        """
        try:
            return self._exchange(frames)
        except (BusError, _LockStepError) as error:
            raise can.CanOperationError(str(error)) from error

    def _exchange(self, frames: Sequence[Frame]) -> list[Frame]:
        # After Ctrl-C in the middle of an exchange the rest of it comes now, and was asked for.
        unasked = [] if self._is_interrupted else self._take()
        self._is_interrupted = True
        for frame in frames:
            if _SDO_REQUEST < frame.can_id < _SDO_REQUEST + 0x80 and not frame.is_extended:
                self._busy = frame.can_id - _SDO_REQUEST
        self._transport.send([*(frame for frame in frames if frame != _SYNC), _SYNC])
        self._refuse(unasked)
        self._collect_all()
        self._is_interrupted = False
        brought, self._brought = self._brought, []
        self._check_heartbeats(brought)
        return brought

    def _check_heartbeats(self, brought: Sequence[Frame]) -> None:
        """At the first heartbeat, see that the next does not come by itself: that is real time."""
        if not self._has_heard_heartbeat and any(
            _HEARTBEAT < frame.can_id < _HEARTBEAT + 0x80 for frame in brought
        ):
            self._has_heard_heartbeat = True
            self._transport.wait(QUIET)
            self._refuse(self._take())

    def _find_nodes(self) -> None:
        """Ask until nodes have answered, and nothing more comes; a bus that goes on is refused.

        Raises:
            _LockStepError: the answers have no end.
        """
        deadline = self._clock() + START_TIMEOUT
        while not self._answered and self._clock() < deadline:
            self._ask(self._node_ids)
            end = self._clock() + ANSWER_TIMEOUT
            while self._transport.wait(ANSWER_TIMEOUT if self._asked else QUIET):
                frames = self._take()
                if self._clock() > end:
                    self._refuse(frames)
                if self._clock() > end + ANSWER_TIMEOUT:
                    raise _LockStepError("SDO answers come without end; each node was asked once")

    def _refuse(self, unasked: Sequence[Frame]) -> None:
        """Refuse frames that nothing of ours has brought.

        Raises:
            _LockStepError: there are some.
        """
        if unasked:
            raise _LockStepError(
                f"frame 0x{unasked[0].can_id:03X} came unasked; lock-step needs a bus on which "
                "nothing happens between two of our SYNCs, as of 'hil-bench run --lockstep'"
            )

    def _collect_all(self) -> None:
        """Take all that comes up to the end mark.

        Raises:
            _LockStepError: it does not come.
        """
        # A second request to an SDO server would end the controller's own transfer.
        free = [node_id for node_id in self._node_ids if node_id != self._busy]
        for node_id in free[:MOST_ASKED]:
            self._ask([node_id])
            if self._collect_until_answered():
                return
            # It may be switched off: from now on others are asked first.
            self._node_ids.remove(node_id)
            self._node_ids.append(node_id)
        asked = " and ".join(map(str, free[:MOST_ASKED]))
        raise _LockStepError(
            f"no answer from node {asked} within {ANSWER_TIMEOUT:g} s; is the bench still there?"
        )

    def _ask(self, node_ids: Sequence[int]) -> None:
        self._asked, self._answered = set(node_ids), set()
        self._transport.send([Frame(_SDO_REQUEST + node_id, _REQUEST) for node_id in node_ids])

    def _collect_until_answered(self) -> bool:
        """Take what comes until the node that was asked has answered; return whether it has."""
        deadline = self._clock() + ANSWER_TIMEOUT
        while self._asked:
            remaining = deadline - self._clock()
            if remaining <= 0.0:
                return False
            if self._transport.wait(remaining):
                self._brought += self._take()
        return True

    def _take(self) -> list[Frame]:
        """Return the received frames without the end marks, which are noted."""
        frames = []
        for frame in self._transport.receive(FRAMES_AT_ONCE):
            is_answer = frame.can_id & ~0x7F == _SDO_ANSWER and len(frame.data) == 8
            if not is_answer or frame.data[1:4] != _REQUEST[1:4]:
                frames.append(frame)
            elif (node_id := frame.can_id & 0x7F) in self._asked:
                self._asked.remove(node_id)
                self._answered.add(node_id)
        return frames
