"""A running program on the bench's clock."""

import contextlib
import math
import os
import select
import signal
import socket
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

from hil_bench.abilities.controllers.patience import Lapse, Patience
from hil_bench.abilities.controllers.process.program import Program, environment
from hil_bench.abilities.controllers.program.exchange import NAME_SIZE, RING, Exchange
from hil_bench.abilities.controllers.seam import ControllerEnd, Surroundings, TimedFrame
from hil_bench.bench.configuration.records import FIRST_BUS
from hil_bench.errors import ControllerError

LEAVE_NS = 1_000_000_000
"""Bench time that a program has to end after SIGTERM, before it is killed."""

PATIENCE = 10.0
"""Time for which a program may neither work nor wait for the bench [s]."""

LEAD_NS = 100_000_000
"""Time by which the bench of a program in real time may be ahead of the machine's clock."""

LEAVE = 1.0
"""Time that a program in real time has to end after SIGTERM [s]."""

_GLANCE_MS = 200  # between two looks at a program that does not answer
_WAITS, _IS_FULL, _IS_REFUSED = b"w", b"f", b"r"
_GO_ON = b"g"


class ProgramController:
    """A program with a library preloaded that gives it CAN sockets and bench time.

    Args:
        command: its words; ``{bus}`` stands for its first interface.
        library: the library.
        is_real: whether it keeps the machine's clocks.
        cpu_s_per_tick: processor time that it may take between two waits [s].
        surroundings: where it lives.

    Raises:
        ControllerError: it cannot be started.
    """

    has_begun = True  # nobody knows what it does

    def __init__(
        self,
        command: Sequence[str],
        library: Path,
        cpu_s_per_tick: float,
        surroundings: Surroundings,
        *,
        is_real: bool = False,
    ) -> None:
        self._library, self._surroundings = library, surroundings
        self._cpu_s_per_tick, self._is_real = cpu_s_per_tick, is_real
        self._names = interface_names(surroundings.buses)
        words = [surroundings.filled(word) for word in command]
        self._command = [word.replace("{bus}", self._names[0]) for word in words]
        self._now: int | None = None
        self._starts = 0
        self._life: _Life | None = None
        self._program: Program | None = None

    @property
    def partner(self) -> int:
        """The process; 0 for none, or where it keeps the machine's clocks."""
        if self._is_real or self._life is None or self._program is None:
            return 0
        return self._program.process.pid

    def advance(self, until: int, received: Sequence[TimedFrame]) -> Sequence[TimedFrame]:
        """Let the program live until it waits for something later than `until`.

        A `ControllerEnd` says that it has ended with exit code 0, a `ControllerError` that it has
        with another one, or cannot live on the bench's clock.
        """
        if self._life is None:
            begin = until - self._surroundings.tick_ns if self._now is None else self._now
            self._life = self._start(begin)
            # At its very first moment it has no socket open yet.
            received = [each for each in received if each.time > begin]
        self._now = until
        return self._life.advance(until, received)

    def reset(self) -> None:
        """Kill the program; it starts anew at the next `advance`."""
        self._end()

    def tail(self) -> str:
        """The end of what the program has printed."""
        return self._program.tail() if self._program is not None else ""

    def close(self) -> None:
        """End the program by SIGTERM, with some bench time to do so."""
        if self._life is not None and self._now is not None:
            self._life.leave(self._now, self._surroundings.tick_ns)
        self._end()

    def _end(self) -> None:
        life, self._life = self._life, None
        if life is not None:
            life.end()

    def _start(self, now: int) -> "_Life":
        """Start the program at a bench time [ns].

        Raises:
            ControllerError: it cannot be started.
        """
        self._starts += 1
        directory = self._surroundings.scratch / f"program{self._starts}"
        directory.mkdir()
        exchange = Exchange(self._names, now, is_real=self._is_real)
        ours, theirs = socket.socketpair()
        preloaded = f"{self._library} {os.environ.get('LD_PRELOAD', '')}".strip()
        variables = environment(self._names[0]) | {
            "HIL_BENCH_PROGRAM": f"{theirs.fileno()},{exchange.descriptor}",
            "LD_PRELOAD": preloaded,
            "PYTHONHASHSEED": "0",
        }
        descriptors = (theirs.fileno(), exchange.descriptor)
        try:
            with theirs:
                self._program = Program(
                    self._command, directory, variables, descriptors=descriptors, leads=True
                )
        except ControllerError:
            exchange.close()
            ours.close()
            raise
        if self._is_real:
            return _RealLife(self._program, exchange, ours, now)
        return _Life(self._program, exchange, ours, self._cpu_s_per_tick)


class _Life:
    """A program from its start to its end.

    Args:
        program: as started.
        exchange: the memory that it shares.
        control: the socket by which both ring.
        cpu_s_per_tick: see `ProgramController`.
    """

    def __init__(
        self, program: Program, exchange: Exchange, control: socket.socket, cpu_s_per_tick: float
    ) -> None:
        self._program, self._exchange, self._control = program, exchange, control
        self._cpu_s_per_tick = cpu_s_per_tick
        self._pidfd = os.pidfd_open(program.process.pid)
        self._poller = select.poll()
        self._poller.register(control, select.POLLIN)
        self._poller.register(self._pidfd, select.POLLIN)
        self._wake = 0
        self._has_failed = False
        self._sent: list[TimedFrame] = []

    def advance(self, until: int, received: Sequence[TimedFrame]) -> Sequence[TimedFrame]:
        """See `ProgramController`.

        Raises:
            ControllerError: likewise.
        """
        if not received and until < self._wake and not self._poller.poll(0):
            self._exchange.pass_time(until)
            return ()
        try:
            while len(received) > RING:
                self._live(received[RING - 1].time, received[:RING])
                received = received[RING:]
            self._live(until, received)
        except ControllerError:
            self._has_failed = True
            raise
        sent, self._sent = self._sent, []
        return sent

    def leave(self, now: int, tick_ns: int) -> None:
        """Ask the program by SIGTERM to end, and let it live for `LEAVE_NS` at most."""
        if self._has_failed or not self._program.is_running:
            return
        self._program.process.send_signal(signal.SIGTERM)
        with contextlib.suppress(ControllerError, ControllerEnd):
            for until in range(now + tick_ns, now + LEAVE_NS, tick_ns):
                self._live(until, ())

    def end(self) -> None:
        """Kill what still lives of the program, and let go of what was shared."""
        self._program.kill()
        os.close(self._pidfd)
        self._control.close()
        self._exchange.close()

    def _live(self, until: int, received: Sequence[TimedFrame]) -> None:
        """Grant time, and keep what is sent meanwhile.

        Raises:
            ControllerError: it neither waits nor ends.
        """
        self._exchange.grant(until, received)
        self._ring()
        patience = Patience(self._program.process.pid, self._cpu_s_per_tick, PATIENCE)
        while not self._hear():
            if lapse := patience.find_lapse():
                raise ControllerError(f"at {until * 1e-9:.3f} s {self._words(lapse)}")
        self._sent += self._exchange.take()
        self._wake = self._exchange.wake

    def _words(self, lapse: Lapse) -> str:
        if lapse is Lapse.COMPUTES:
            return (
                f"it took {self._cpu_s_per_tick:g} s of processor time and did not wait once; "
                "a program that computes for longer needs more cpu_s_per_tick"
            )
        return (
            f"for {PATIENCE:g} s it has neither worked nor waited for the bench; "
            "a child process, a lock or a file keeps it"
        )

    def _ring(self) -> None:
        with contextlib.suppress(ConnectionError):  # it has ended: seen by `_hear`
            self._control.send(_GO_ON)

    def _hear(self) -> bool:
        """Wait for the program a moment; return True if it has lived to the end of its grant.

        Raises:
            ControllerError: it cannot live on the bench's clock.
        """
        ready = self._poller.poll(_GLANCE_MS)
        if not ready:
            return False
        mark = b""
        if ready[0][0] == self._control.fileno():
            with contextlib.suppress(ConnectionError):
                mark = self._control.recv(1)
        if mark == _WAITS:
            return self._exchange.is_lived
        if mark == _IS_REFUSED:
            raise ControllerError(self._exchange.refusal)
        if mark == _IS_FULL:
            self._sent += self._exchange.take()
            self._ring()
            return False
        if self._program.is_running:  # it has closed what is not its own
            return False
        self._end_in_order()
        return True

    def _end_in_order(self) -> None:
        """Say how the program has ended.

        Raises:
            ControllerEnd: with exit code 0.
            ControllerError: with another one.
        """
        code = self._program.process.wait()
        self._sent += self._exchange.take()
        if not self._exchange.is_attached:
            raise ControllerError("the bench's library was not loaded before it")
        if code:
            raise ControllerError(self._program.epitaph())
        raise ControllerEnd("exit code 0", self._sent)


class _RealLife(_Life):
    """A program that keeps the machine's clocks, beside a bench that keeps up with them.

    Args:
        program: as started.
        exchange: the memory that it shares.
        control: the socket by which the bench rings.
        now: bench time at its start [ns].
    """

    def __init__(
        self, program: Program, exchange: Exchange, control: socket.socket, now: int
    ) -> None:
        super().__init__(program, exchange, control, math.inf)
        self._zero = time.monotonic_ns() - now
        control.setblocking(False)

    def advance(self, until: int, received: Sequence[TimedFrame]) -> Sequence[TimedFrame]:
        """Hand out what has come, and take what the program has sent by now.

        Raises:
            ControllerError: the bench does not keep to the machine's clock.
        """
        if not self._program.is_running:
            self._end_in_order()
        if until - (time.monotonic_ns() - self._zero) > LEAD_NS:
            raise ControllerError(
                'time = "real" needs a bench that keeps to the machine\'s clock, and this one runs '
                'ahead of it; run it paced, or give time = "bench"'
            )
        if received:
            self._exchange.grant(until, received[: self._exchange.room])
            with contextlib.suppress(OSError):  # it has ended, or has not listened for long
                self._control.send(_GO_ON)
        return [TimedFrame(until, frame) for _, frame in self._exchange.take()]

    def leave(self, now: int, tick_ns: int) -> None:
        """Ask the program by SIGTERM to end, and give it `LEAVE`."""
        del now, tick_ns
        self._program.process.send_signal(signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._program.process.wait(LEAVE)


def interface_names(buses: Sequence[str]) -> list[str]:
    """Return the names of buses as network interfaces: their own, or can0 and so on."""
    return [
        name if name != FIRST_BUS and len(name.encode()) < NAME_SIZE else f"can{number}"
        for number, name in enumerate(buses)
    ]
