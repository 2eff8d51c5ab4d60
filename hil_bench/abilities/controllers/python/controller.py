"""A Python controller that waits in its drivers while the bench goes on.

It runs on a stack of its own (greenlet). Where it waits on a bus for the next tick, the stack is
left, and entered again when the bench asks the controller to live on.
"""

import inspect
import logging
import sys
import traceback
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import closing, redirect_stdout, suppress
from functools import partial
from typing import TYPE_CHECKING, Any, NoReturn

import can
from greenlet import greenlet

from hil_bench.abilities.controllers.seam import Controller, ControllerEnd, Surroundings, TimedFrame
from hil_bench.abilities.controllers.standstill import Overdue
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ControllerError
from hil_bench.outside.transports.embedded import EmbeddedBus, EmbeddedPort
from hil_drivers import DriverError, Network

if TYPE_CHECKING:
    from hil_bench.bench.configuration import BenchConfig


_PARTS = ("advance", "reset", "tail", "close", "has_begun")
_MOST_REFUSALS = 1000
"""How often a controller that is closed may wait, as its cleaning up does."""

_LONGEST = 1000
"""Characters of an exception that messages show."""

_UNENDING: list[greenlet] = []
"""Stacks that take every exception for their own and never end; without power, each stays there."""


class _Parameters(dict[str, float]):
    """Parameters by name; one that is missing is a KeyError that says who gives it."""

    def __missing__(self, name: str) -> NoReturn:
        known = ", ".join(self) or "none"
        raise KeyError(f"{name}: give it in [parameters] of a scenario; there is {known}")


class Rig:
    """The rig that a Python controller is given.

    Args:
        bus: its first bus; bench time passes while it waits there.
        surroundings: where it lives.

    Attributes:
        bus: as passed in, a python-can bus.
        buses: all its buses, by their names in the configuration.
        config: of the bench.
        parameters: of the scenario by name, in their own units.
    """

    def __init__(self, bus: EmbeddedBus, surroundings: Surroundings) -> None:
        self.bus = bus
        self.buses: Mapping[str, EmbeddedPort] = {
            name: bus.make_further() if number else bus
            for number, name in enumerate(surroundings.buses)
        }
        self.config: BenchConfig = surroundings.config
        self.parameters: Mapping[str, float] = _Parameters(surroundings.values)

    def now(self) -> float:
        """Return the bench time [s]."""
        return self.bus.now()

    def sleep(self, duration: float) -> None:
        """Let bench time pass [s]; what arrives meanwhile waits on the buses."""
        self.bus.advance(duration)

    def network(self, bus: str = "") -> Network:
        """Return a network for drivers.

        Args:
            bus: the name of its bus; empty for the first.
        """
        return Network(self.buses[bus] if bus else self.bus, clock=self.now)


class PythonController:
    """A callable on a stack of its own.

    Args:
        call: given the rig, it works until it returns; or it returns a generator, which is worked
            off and has begun its work with the first ``yield``, or an object with ``advance``.
        surroundings: where it lives.

    Attributes:
        has_begun: whether it has begun its work, which nobody knows of what is no generator.
    """

    def __init__(self, call: Callable[[Rig], object], surroundings: Surroundings) -> None:
        self._call, self._surroundings = call, surroundings
        self._stack: greenlet | None = None
        self._bench: greenlet | None = None
        self._made: Controller | None = None
        self._rig: Rig | None = None
        self.has_begun = True
        self._is_cyclic = self._is_closing = False
        self._failure: BaseException | None = None
        self._leftover: Sequence[Frame] | None = None
        self._is_waiting = False
        self._refusals = 0

    def prepare(self) -> None:
        """Run it until it first waits or reads a bus: imports, drivers, a model in a process.

        Raises:
            KeyboardInterrupt: Ctrl-C, here and in `advance`.
        """
        self._bench = greenlet.getcurrent()
        rig = self._make_rig(self._surroundings.tick_ns, ())
        rig.bus.begin_later(partial(self._wait_for_power, rig.bus))
        self._stack = greenlet(self._live)
        try:
            with redirect_stdout(sys.stderr):
                sent: Sequence[Frame] = self._stack.switch(rig)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # whatever ends it, it is its end, not ours
            self._failure = error
        else:
            self._leftover = sent if self._stack.dead else None
        rig.bus.begin_later(None)

    def advance(self, until: int, received: Sequence[TimedFrame]) -> Sequence[TimedFrame]:
        """Let it run until it waits for a time behind `until`.

        Raises:
            ControllerEnd: it has returned, or a device has ended it in its work.
            KeyboardInterrupt: Ctrl-C; every other exception is a `ControllerError` that says where.
        """
        if self._made is None:
            timed = [TimedFrame(until, frame) for frame in self._run(until, received)]
            if self._stack is not None:
                return timed
            if self._made is None:
                raise ControllerEnd("it has returned", timed)
        try:
            with redirect_stdout(sys.stderr):
                sent = _timed(self._made.advance(until, received))
            self.has_begun = bool(self._made.has_begun)
        except (ControllerEnd, KeyboardInterrupt):
            raise
        except BaseException as error:  # whatever ends it, it is its end, not ours
            raise self._ending(error, until) from error
        return sent

    def reset(self) -> None:
        """Take its power away."""
        self.close()

    def tail(self) -> str:
        """Return nothing: what it prints goes to standard error."""
        return ""

    def close(self) -> None:
        """End it where it waits; its own cleaning up can wait no longer."""
        self._is_closing = True
        made, self._made = self._made, None
        self._bench = greenlet.getcurrent()
        logging.disable()  # it has no power any more, and its cleaning up nothing to say
        with redirect_stdout(sys.stderr), suppress(Exception, SystemExit):
            if made is not None:
                made.close()
            if self._stack is not None and not self._stack.dead:
                self._stack.throw()
                _UNENDING.extend(() if self._stack.dead else (self._stack,))
        logging.disable(logging.NOTSET)
        for bus in self._rig.buses.values() if self._rig is not None else ():
            bus.shutdown()

    def _run(self, until: int, received: Sequence[TimedFrame]) -> Sequence[Frame]:
        """Enter the stack until it is left; forget it where it has come to its end.

        Raises:
            KeyboardInterrupt: Ctrl-C.
        """
        self._bench = greenlet.getcurrent()
        try:
            with redirect_stdout(sys.stderr):
                sent = self._enter(until, received)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # whatever ends it, it is its end, not ours
            raise self._ending(error, until) from error
        if self._stack is not None and self._stack.dead:
            self._stack = None
        return sent

    def _enter(self, until: int, received: Sequence[TimedFrame]) -> Sequence[Frame]:
        """Enter the stack until it is left; return what it has sent."""
        if self._failure is not None:
            raise self._failure
        if self._leftover is not None:
            return self._leftover
        stack, is_waiting, self._is_waiting = self._stack, self._is_waiting, False
        sent: Sequence[Frame]
        if stack is None:
            self._stack = greenlet(self._live)
            sent = self._stack.switch(self._make_rig(until, received))
        elif is_waiting:
            sent = stack.switch((until, received))
        else:
            sent = stack.switch([frame for _, frame in received])
        return sent

    def _ending(self, error: BaseException, until: int) -> Exception:
        """Return the end of the controller by an exception, as the bench knows ends."""
        if isinstance(error, ControllerError):
            return error
        if isinstance(error, Overdue):
            return ControllerError(_place(error, self._call))
        if not self.has_begun and isinstance(error, (DriverError, ValueError)):
            return ControllerError(f"the controller could not work: {error}")
        if self._is_cyclic and isinstance(error, DriverError):
            sent = [] if self._rig is None else self._rig.bus.take_sent()
            return ControllerEnd(str(error), [TimedFrame(until, frame) for frame in sent])
        return ControllerError(_place(error, self._call))

    def _make_rig(self, until: int, received: Sequence[TimedFrame]) -> Rig:
        """Make its rig, with what came while it started."""
        tick_ns = self._surroundings.tick_ns
        bus = EmbeddedBus(self._exchange, tick_ns, start_ns=until - tick_ns)
        rig = Rig(bus, self._surroundings)
        bus.hear([frame for _, frame in received])
        self._rig = rig
        return rig

    def _live(self, rig: Rig) -> Sequence[Frame]:
        made: Any = self._call(rig)
        if isinstance(made, Generator):
            self._is_cyclic, self.has_begun = True, False
            with closing(made):
                for _ in made:
                    self.has_begun = True
        elif hasattr(made, "advance"):
            lacking = [part for part in _PARTS if not hasattr(made, part)]
            if lacking:
                right = f"a controller's object has {', '.join(_PARTS)}"
                wrong = f"{type(made).__name__} has no {lacking[0]}; {right}"
                raise ControllerError(wrong)
            self._made = made
        return rig.bus.take_sent()

    def _wait_for_power(self, bus: EmbeddedBus) -> int:
        """Leave the stack until bench time begins; return when that is [ns]."""
        if self._is_closing or self._bench is None:
            self._refuse()
        self._is_waiting = True
        until: int
        until, received = self._bench.switch(())
        bus.hear([frame for _, frame in received])
        return until - self._surroundings.tick_ns

    def _exchange(self, frames: Sequence[Frame], _now: int) -> Sequence[Frame]:
        """Leave the stack until the bench has ticked; return what came then."""
        if self._is_closing or self._bench is None:
            self._refuse()
        received: Sequence[Frame] = self._bench.switch(frames)
        return received

    def _refuse(self) -> NoReturn:
        """Say that the run is over; what takes no notice of that is left where it waits.

        Raises:
            can.CanOperationError: always.
        """
        self._refusals += 1
        while self._refusals > _MOST_REFUSALS and self._bench is not None:
            self._bench.switch(())
        raise can.CanOperationError("the run is over")


def _timed(given: object) -> Sequence[TimedFrame]:
    """Return the frames that `advance` has given, each with its time; for None an empty list.

    Raises:
        ControllerError: it is something else.
    """
    frames: list[TimedFrame] = []
    each: object
    for each in () if given is None else given if isinstance(given, Iterable) else (given,):
        match each:
            case (int(time), Frame() as frame):
                frames.append(TimedFrame(time, frame))
            case _:
                right = "a sequence of TimedFrame is right"
                raise ControllerError(f"advance gives {each!a:.60}; {right}")
    return frames


def _place(error: BaseException, call: Callable[[Rig], object]) -> str:
    """Return the exception in words, with the line of the user's file."""
    file = inspect.getsourcefile(inspect.unwrap(call)) if inspect.isroutine(call) else None
    trace = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in trace if frame.filename == file] or trace
    name = type(error).__name__
    if name.lower() == "error":  # of struct, of binascii
        name = f"{type(error).__module__}.{name}"
    what = " ".join(f"{name}: {error}".split()) if not isinstance(error, Overdue) else str(error)
    return f"{own[-1].filename}:{own[-1].lineno}: {what[:_LONGEST]}"
