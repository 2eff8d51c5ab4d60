"""Firmware under test, in a process of its own: its bus, and the time base of bench and bus."""

import signal
import time
from collections.abc import Callable, Sequence
from operator import methodcaller
from pathlib import Path
from typing import Protocol

from hil_bench.abilities.controllers.process.hosted_bus import HostedBus
from hil_bench.abilities.controllers.process.program import (
    USUAL_PATIENCE,
    Patience,
    Program,
    Silence,
    environment,
)
from hil_bench.abilities.controllers.turns import Turns
from hil_bench.abilities.hub.process import HubProcess
from hil_bench.abilities.lockstep.lockstep import LockStep, LockStepBus
from hil_bench.bench.paced import frames_per_tick
from hil_bench.bench.session import Session
from hil_bench.bench.virtual_bench import VirtualBench
from hil_bench.errors import BusError, ConfigError, ControllerError, HilBenchError, WaitTimeoutError
from hil_bench.outside.realtime.clock import Clock, MonotonicClock
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.transports.opening import JoinedTransport, open_transport
from hil_bench.outside.transports.transport import PATIENCE, Transport

# The time base of a bench whose controller is another program on a bus.
#
# In lock-step the controller's SYNC does; in real time the clock does, and the controller keeps
# up. Both are the same to who waits: `advance` returns when bench time has come to a moment.

# Of an error that says what a test's controller did wrong, pytest shows the test's own line.
__tracebackhide__ = methodcaller("errisinstance", HilBenchError)


class ControllerLink(Protocol):
    """A bench and its controller on one bus."""

    @property
    def now(self) -> int:
        """The bench time [ns]."""

    def step(self) -> bool:
        """Let a little happen, at most one tick or period; return whether frames came."""

    def drain(self) -> None:
        """Answer what has arrived already, without waiting for more."""


class LockStepLink:
    """A bench whose time the controller's SYNC lets pass.

    Args:
        lockstep: the bench, powered on.
        transport: the bus.
        patience: with its controller.
        clock: the machine's clock; None is the monotonic one.
        partners: returns the processes that live while the bench waits for them.

    Attributes:
        turns: of the bench and these.
    """

    def __init__(
        self,
        lockstep: LockStep,
        transport: Transport,
        patience: Patience = USUAL_PATIENCE,
        *,
        clock: Clock | None = None,
        partners: Callable[[], Sequence[int]] = tuple,
    ) -> None:
        self._lockstep = lockstep
        self._bus = LockStepBus(lockstep, transport)
        self._silence = Silence(patience, clock)
        self._partners = partners
        self.turns = Turns()

    @property
    def now(self) -> int:
        """The bench time [ns]."""
        return self._lockstep.now

    def step(self) -> bool:
        """Take the next frame; return whether one came within `transport.PATIENCE`.

        A `ControllerError` says that no SYNC has come for as long as its patience lasts.
        """
        syncs = self._lockstep.syncs
        self._silence.begin()
        has_come = self._bus.step()
        has_synced = self._lockstep.syncs != syncs
        self._silence.end(has_come=has_come, has_synced=has_synced)
        if has_synced:
            self.turns.take(self._partners)
        return has_come

    def drain(self) -> None:
        """Answer what has arrived already, without waiting for more."""
        while self._bus.step(0.0):
            pass


class RealTimeLink:
    """A bench whose time the clock lets pass, beside a controller that keeps up with it.

    Args:
        session: the bench, powered on.
        transport: the bus.
        pacer: a new one, its grid not yet begun.
    """

    def __init__(self, session: Session, transport: Transport, pacer: Pacer) -> None:
        self._session = session
        self._transport = transport
        self._pacer = pacer
        self._limit = frames_per_tick(pacer.period)
        self._offset: int | None = None

    @property
    def now(self) -> int:
        """The bench time [ns]."""
        return self._session.now

    def step(self) -> bool:
        """Run the next tick when it is due; return whether frames had come for it."""
        scheduled = self._pacer.wait()
        if self._offset is None:
            self._offset = self.now + self._pacer.period - scheduled
        received = self._transport.receive(self._limit)
        self._session.tick(received, scheduled + self._offset, self._transport.send)
        self._pacer.done()
        return bool(received)

    def drain(self) -> None:
        """Run the next tick, which takes what has arrived."""
        self.step()


def advance(link: ControllerLink, duration: int, check: Callable[[], None]) -> None:
    """Let `duration` [ns] of bench time pass; `check` is called whenever nothing came."""
    end = link.now + duration
    while link.now < end:
        if not link.step():
            check()


def join(
    bench: VirtualBench,
    transport: Transport,
    *,
    pacer: Pacer | None = None,
    patience: Patience = USUAL_PATIENCE,
    partners: Callable[[], Sequence[int]] = tuple,
    check: Callable[[], None],
) -> ControllerLink:
    """Put a bench on a bus where another program controls it, in place of its own `buses`.

    From now on bench time passes in `run` and `run_until` as before, and in the link's `step`: by
    that program's SYNC, `config.sync_period_ns` each; or by the clock where there is a pacer.

    Args:
        bench: it.
        transport: the bus, or a `JoinedTransport`; it stays the caller's.
        pacer: paces the bench in real time; None is lock-step.
        patience: with a controller in lock-step.
        partners: returns the processes that live only while a bench in lock-step waits for them.
        check: called in `run` and `run_until` when nothing came from the bus; raises where nothing
            will come any more.

    Returns:
        Bench and bus as one.
    """
    bench.leave_buses(lambda duration: advance(link, round(duration * 1e9), check))
    session, config = bench.session, bench.config
    if not session.now:
        transport.send(session.tick((), 0))  # all boot
    link: ControllerLink
    if pacer is None:
        lockstep = LockStep(session, tick_ns=config.tick_ns, ticks_per_sync=config.ticks_per_sync)
        link = LockStepLink(lockstep, transport, patience, partners=partners)
    else:
        link = RealTimeLink(session, transport, pacer)
    return link


# A program on the bench's bus: the firmware under test, in a process of its own.

# Of an error that says what a test's controller did wrong, pytest shows the test's own line.

HUB = "hub"
"""Name of the bus that the bench hosts itself."""

GRACE = 10.0
"""Time that a program has to end after SIGTERM, before it is killed [s]."""


class FirmwareBus:
    """The bus between the bench of a test and its firmware, joined by the first program on it.

    Args:
        bench: the bench of the test.
        name: "hub", or the name of a SocketCAN interface.
        is_realtime: whether the clock lets bench time pass; otherwise the firmware's SYNC does.
        patience: with firmware that sends no SYNC.

    Attributes:
        address: how a program is told of the bus: "vcan0", or "127.0.0.1:PORT".
        variables: the same as environment variables, for python-can too.
    """

    def __init__(
        self,
        bench: VirtualBench,
        name: str,
        *,
        is_realtime: bool,
        patience: Patience = USUAL_PATIENCE,
    ) -> None:
        self._is_realtime = is_realtime
        self._hub: HubProcess | None = None
        self._programs: list[Firmware] = []
        self._transport, self.address = self._open(
            name, len(bench.config.buses), is_realtime=is_realtime
        )
        self.variables = environment(self.address)
        pacer = Pacer(MonotonicClock(), bench.config.tick_ns) if is_realtime else None
        self.link = join(
            bench,
            self._transport,
            pacer=pacer,
            patience=patience,
            partners=self._partners,
            check=self._check,
        )

    def start(self, command: Sequence[str | Path], directory: Path) -> "Firmware":
        """Start a program; see the `firmware` fixture."""
        words = [str(word).replace("{bus}", self.address) for word in command]
        program = Firmware(words, directory, self)
        self._programs.append(program)
        return program

    def close(self) -> None:
        """End all programs, the last first, and close the bus."""
        if isinstance(self.link, LockStepLink):
            self.link.turns.end()
        for program in reversed(self._programs):
            program.stop()
        self._transport.close()
        if self._hub is not None:
            self._hub.__exit__(None, None, None)

    def report(self) -> str:
        """Return the state of each program, with its exit code, and the end of its output."""
        return "\n".join(program.epitaph() for program in self._programs)

    def _partners(self) -> list[int]:
        """Return the process of the only program; several may run beside each other."""
        running = [program.process.pid for program in self._programs if program.is_running]
        return running if len(running) == 1 else []

    def _check(self) -> None:
        """Say so where no program is left that could let time pass, or no bus.

        Raises:
            ControllerError: all have ended, in lock-step.
            BusError: the hub has died.
        """
        if self._hub is not None and (ending := self._hub.ending()) is not None:
            raise BusError(f"the bench's hub at {self.address}: its process {ending}")
        if not self._is_realtime and all(not program.is_running for program in self._programs):
            raise ControllerError("\n".join(program.epitaph() for program in self._programs))

    def _open(self, name: str, buses: int, *, is_realtime: bool) -> tuple[Transport, str]:
        """Return the bench's end of the bus, and the bus's address.

        A hub has as many buses as the bench: "can0", "can1" and so on.

        Raises:
            ConfigError: a bench with several buses is to be on one interface.
        """
        if name != HUB:
            if buses > 1:
                raise ConfigError(
                    f"--hil-firmware-bus {name}: the bench has {buses} buses; "
                    f"{HUB} gives the firmware all of them"
                )
            return open_transport("socketcan", name, None, {}), name
        channels = [f"can{number}" for number in range(buses)]
        if not is_realtime:
            hosted = HostedBus(channels=channels)
            return hosted, f"{hosted.host}:{hosted.port}"
        # In real time the hub must relay while the bench is at work.
        self._hub = HubProcess(port=0, channels=channels).__enter__()
        address = f"{self._hub.host}:{self._hub.port}"
        ends = [self._hub.join(channel) for channel in channels]
        return ends[0] if buses == 1 else JoinedTransport(ends), address


class Firmware(Program):
    """A running program on the bus of a test.

    Args:
        command: its words.
        directory: for its output.
        bus: that it is on.

    Raises:
        ControllerError: it cannot be started.
    """

    def __init__(self, command: Sequence[str], directory: Path, bus: FirmwareBus) -> None:
        super().__init__(command, directory, bus.variables)
        self._bus = bus

    @property
    def link(self) -> ControllerLink:
        """Bench and bus."""
        return self._bus.link

    def wait(self, timeout: float) -> int:
        """Let bench time pass until the program has ended by itself; return its exit code.

        Args:
            timeout: longest wait, in bench time [s].

        Raises:
            WaitTimeoutError: it still runs.
        """
        end = self.link.now + round(timeout * 1e9)
        while self.is_running:
            if self.link.now >= end:
                raise WaitTimeoutError(
                    f"not ended within {timeout:g} s of bench time: {self.epitaph()}"
                )
            self.link.step()
        self.link.drain()
        return self.process.returncode

    def stop(self, number: int = signal.SIGTERM, *, grace: float = GRACE) -> int:
        """End the program by a signal and return its exit code; the bench serves it meanwhile.

        Args:
            number: the signal.
            grace: time [s] on the machine's clock after which it is killed.
        """
        if self.is_running:
            self.process.send_signal(number)
            if not self._ends_within(grace):
                self.process.kill()
        return self.process.wait()

    def _ends_within(self, grace: float) -> bool:
        """Serve the program while it ends; return whether it did in that time [s]."""
        deadline = time.monotonic() + grace
        while self.is_running and time.monotonic() < deadline:
            try:
                self.link.step()
            except (BusError, ControllerError):  # nothing to serve it on: it must end alone
                time.sleep(PATIENCE)
        return not self.is_running
