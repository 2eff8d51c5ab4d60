"""A program on the bench's hub: it lives from SYNC to SYNC, and the bench waits for the next.

What the bench answers goes out when nothing of the program is left to answer, in one piece: each
piece wakes the program, and a program that asks again with its SYNC has no use for half an answer.
"""

import signal
import time
from collections import deque
from collections.abc import Sequence

from hil_bench.abilities.controllers.process.hosted_bus import HostedBus
from hil_bench.abilities.controllers.process.program import Program, Silence, environment
from hil_bench.abilities.controllers.seam import ControllerEnd, Surroundings, TimedFrame
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.sync import SYNC_COB_ID
from hil_bench.errors import ControllerError
from hil_bench.outside.transports.transport import FRAMES_AT_ONCE, PATIENCE

GRACE = 10.0
"""Time that a program has to end after SIGTERM, before it is killed [s]."""


class ProcessController:
    """A running program, and the hub that it is on.

    Args:
        command: its words; ``{bus}`` stands for the hub's address.
        surroundings: where it lives.

    Raises:
        ControllerError: it cannot be started.
    """

    has_begun = True  # nobody knows what it does

    def __init__(self, command: Sequence[str], surroundings: Surroundings) -> None:
        self._command, self._surroundings = command, surroundings
        channels = [f"can{number}" for number in range(len(surroundings.buses))]
        self._bus = HostedBus(channels=channels)
        self._arrived: deque[Frame] = deque()
        self._answers: list[Frame] = []
        self._silence = Silence()
        self._period = surroundings.config.ticks_per_sync * surroundings.tick_ns
        self._due = 0
        self._starts = 0
        self._program: Program | None = None
        try:
            self._start()
        except BaseException:
            self._bus.close()
            raise

    @property
    def partner(self) -> int:
        """The process; 0 for none."""
        return self._program.process.pid if self._program is not None else 0

    def advance(self, until: int, received: Sequence[TimedFrame]) -> Sequence[TimedFrame]:
        """Let the program live until its next SYNC, where one is due.

        Raises:
            ControllerEnd: the program has ended, with exit code 0.
            ControllerError: it has ended with another one, or sends no SYNC.
        """
        program = self._program or self._start()
        self._answers += [frame for _, frame in received]
        if until < self._due:
            return ()
        while True:
            while self._arrived:
                frame = self._arrived.popleft()
                if _is_sync(frame):
                    self._silence.end(has_come=True, has_synced=True)
                    self._due = until + self._period
                    return (TimedFrame(until, frame),)
                self._serve(frame)
            self._silence.begin()
            has_come = self._listen()
            if not has_come and not program.is_running and not self._take():
                if program.process.returncode:
                    raise ControllerError(program.epitaph())
                raise ControllerEnd("exit code 0")
            try:
                self._silence.end(has_come=has_come, has_synced=False)
            except ControllerError as error:
                raise ControllerError(f"at {until * 1e-9:.3f} s {error}") from None

    def reset(self) -> None:
        """Kill the program; it starts anew at the next `advance`."""
        if self._program is not None:
            self._program.kill()
            self._program = None
        self._arrived.clear()
        self._answers.clear()
        self._bus.receive(1 << 20)

    def tail(self) -> str:
        """The end of what the program has printed."""
        return self._program.tail() if self._program is not None else ""

    def close(self) -> None:
        """End the program by SIGTERM, answer it meanwhile, and close the hub."""
        program, self._program = self._program, None
        if program is not None:
            if program.is_running:
                program.process.send_signal(signal.SIGTERM)
                self._serve_the_leaving(program)
            program.kill()
        self._bus.close()

    def _start(self) -> Program:
        self._starts += 1
        directory = self._surroundings.scratch / f"program{self._starts}"
        directory.mkdir()
        address = f"{self._bus.host}:{self._bus.port}"
        words = [self._surroundings.filled(word) for word in self._command]
        words = [word.replace("{bus}", address) for word in words]
        self._program = Program(words, directory, environment(address), leads=True)
        return self._program

    def _listen(self) -> bool:
        """Wait for frames from the program; return whether some came within `PATIENCE`."""
        self._bus.send(self._answers)  # and what the bus did not take before
        self._answers.clear()
        return self._bus.wait(PATIENCE) and self._take()

    def _take(self) -> bool:
        """Take what the program has sent; return whether there is anything."""
        self._arrived.extend(self._bus.receive(FRAMES_AT_ONCE))
        return bool(self._arrived)

    def _serve(self, frame: Frame) -> None:
        """Have the bench answer a frame while its time stands still."""
        self._answers += [frame for _, frame in self._surroundings.serve((frame,))]

    def _serve_the_leaving(self, program: Program) -> None:
        """Answer a program until it has ended, at most `GRACE` of the machine's time."""
        deadline = time.monotonic() + GRACE
        while program.is_running and time.monotonic() < deadline:
            self._listen()
            while self._arrived:
                self._serve(self._arrived.popleft())


def _is_sync(frame: Frame) -> bool:
    can_id, _, is_remote, is_extended, bus, fd = frame
    return can_id == SYNC_COB_ID and not (is_remote or is_extended or bus or fd)
