"""Controllers on the buses of a session: what each hears, and when what it sends acts."""

import logging
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any

from hil_bench.abilities.controllers import standstill
from hil_bench.abilities.controllers.power import ONLY, Power
from hil_bench.abilities.controllers.seam import (
    AlternatingController,
    BranchingController,
    Controller,
    ControllerEnd,
    ControllerKind,
    PreparingController,
    Surroundings,
    TimedFrame,
    make_timed,
)
from hil_bench.abilities.controllers.turns import Turns
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.session import Session
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ConfigError, ControllerError

logger = logging.getLogger(__name__)

_TIME = attrgetter("time")


@dataclass(frozen=True, slots=True)
class ControllerConfig:
    """A controller of a bench.

    Attributes:
        name: of the controller.
        kind: of controller.
        settings: the values of its table by key, in SI.
        buses: the names of its buses.
        files: that its settings name.
        place: how messages name its table.
        folder: from which relative paths count.
    """

    name: str
    kind: ControllerKind
    settings: Mapping[str, Any]
    buses: tuple[str, ...]
    files: tuple[Path, ...]
    place: str = field(compare=False)
    folder: Path = field(compare=False)


class Desk:
    """The place of one controller: its buses, what waits for it there, and itself.

    Args:
        config: of the controller.
        session: of the bench.
        bench: configuration of the bench.
        scratch: an empty folder.
        values: the parameters of a scenario, in their own units.
        farewell: does what others need where this one never comes back, and the process ends.

    Attributes:
        name: of the controller.
        place: how messages begin; empty for the only controller of a scenario.
        is_due: whether it starts with the next tick.
        ending: how it came to its end by itself; empty where it did not.
    """

    def __init__(
        self,
        config: ControllerConfig,
        session: Session,
        bench: BenchConfig,
        scratch: Path,
        values: Mapping[str, float],
        farewell: Callable[[], None],
    ) -> None:
        self.name = config.name
        self.place = "" if config.name == ONLY else f"controller {config.name}: "
        self.is_due = True
        self.ending = ""
        self._config, self._session, self._scratch = config, session, scratch
        self._numbers = [list(bench.buses).index(name) for name in config.buses]
        self._places = {number: place for place, number in enumerate(self._numbers)}
        self._is_on_all = self._numbers == list(range(len(bench.buses)))
        self._inbox: list[TimedFrame] = []
        self._own: list[Frame] = []
        self._starts = 0
        self._skipped = 0
        self._controller: Controller | None = None
        self._surroundings = Surroundings(
            config.name,
            config.place,
            config.folder,
            scratch,
            config.buses,
            bench,
            values,
            bench.tick_ns,
            self._serve,
        )
        self._guard = standstill.Guard(
            self.place or f"{config.place}: ",
            config.settings.get("patience_s", standstill.USUAL_PATIENCE),
            is_native=config.kind.is_native,
            farewell=farewell,
        )
        session.watch(frames=self._hear)

    @property
    def is_running(self) -> bool:
        """Return True if it is switched on and has not come to its end."""
        return self._controller is not None

    @property
    def kind(self) -> ControllerKind:
        """Return its kind."""
        return self._config.kind

    @property
    def has_begun(self) -> bool:
        """Return True unless it runs and has not begun its work yet."""
        return self._controller is None or self._controller.has_begun

    def live(self, until: int, skipped: int) -> Sequence[TimedFrame]:
        """Let the controller live until a moment; return what it has sent, in order of time.

        Args:
            until: the moment, in time without the ticks that were skipped [ns].
            skipped: how much time these were [ns].

        A `ControllerError` says that it has failed, does not come back, or cannot be started.
        """
        self._skipped = skipped
        received: Sequence[TimedFrame] = self._inbox
        self._inbox = []
        if self._session.bench.medium is None:
            self._own.clear()  # on copper they are heard when they have passed
        self._guard.until = until
        try:
            if self.is_due:
                received = self._start(received)
            if self._controller is None:
                return ()
            sent = self._advance(self._controller, until, received)
        except ControllerEnd as end:
            sent, self.ending = end.sent, str(end)
            self.switch_off()
            if self.place:  # of a scenario's own its result says so
                words = f": {end}" if str(end) else ""
                logger.warning("%.3f s: %shas ended%s", until * 1e-9, self.place, words)
        except (ControllerError, standstill.Overdue) as error:
            raise self._placed(error) from error
        finally:
            self._rest()
        return self._take(sent) if sent else ()

    def prepare(self) -> None:
        """Build the controller that starts with the first tick, and do what needs no time.

        A `ControllerError` says that it cannot be started.
        """
        if not self.is_due or self.is_running:
            return
        self._guard.until = 0
        try:
            self._start(())
            if isinstance(self._controller, PreparingController):
                self._controller.prepare()
        except (ControllerError, standstill.Overdue) as error:
            raise self._placed(error) from error
        finally:
            self._rest()

    def switch_off(self, *, at_once: bool = False) -> None:
        """End the controller; a second call does nothing.

        Args:
            at_once: as a loss of power does.

        A `ControllerError` says that it does not come to its end.
        """
        controller, self._controller = self._controller, None
        self.is_due = False
        if controller is None:
            return
        self._guard.until = self._session.now
        try:
            if at_once:
                controller.reset()
            controller.close()
        except standstill.Overdue as late:
            raise self._placed(late) from late
        finally:
            self._rest()

    @property
    def partner(self) -> int:
        """The process of an `AlternatingController`; 0 for none."""
        running = self._controller
        return running.partner if isinstance(running, AlternatingController) else 0

    def branching(self) -> BranchingController | None:
        """Return the controller where it runs in a process of its own and can branch."""
        running = self._controller
        return running if isinstance(running, BranchingController) else None

    def tail(self) -> str:
        """The end of what it has printed."""
        return self._controller.tail() if self._controller is not None else ""

    def _placed(self, error: ControllerError | standstill.Overdue) -> ControllerError:
        """Return an error of the controller that names it."""
        kind = type(error) if isinstance(error, ControllerError) else ControllerError
        return kind(f"{self.place}{error}")

    def _rest(self) -> None:
        """Have the guard wait for the next call, or let it go where the controller is no more."""
        self._guard.until = None
        if self._controller is None:
            standstill.unwatch(self._guard)

    def _advance(
        self, controller: Controller, until: int, received: Sequence[TimedFrame]
    ) -> Sequence[TimedFrame]:
        """Let the controller live; a copy of this process that it makes by fork ends here."""
        own = os.getpid()
        try:
            return controller.advance(until, received)
        finally:
            if os.getpid() != own:
                logger.warning(
                    "%sthe controller has forked; the copy of the bench ends", self.place
                )
                os._exit(1)

    def _take(self, sent: Sequence[TimedFrame]) -> Sequence[TimedFrame]:
        """Return frames that it has sent as those of the bench, in order of time."""
        taken: list[TimedFrame] = []
        is_sorted, last = True, 0
        for each in sent:
            time, frame = each
            known = frame if self._is_on_all and not frame.bus else self._to_bench(frame)
            self._own.append(known)
            taken.append(each if known is frame else make_timed(TimedFrame, (time, known)))
            is_sorted = is_sorted and time >= last
            last = time
        return taken if is_sorted else sorted(taken, key=_TIME)

    def _start(self, received: Sequence[TimedFrame]) -> Sequence[TimedFrame]:
        """Build the controller, in a new folder; return what it has heard already."""
        self.is_due = False
        self.ending = ""
        self._starts += 1
        scratch = self._scratch / str(self._starts)
        if self._config.kind.uses_files:
            scratch.mkdir(parents=True)
        surroundings = self._surroundings._replace(scratch=scratch)
        if self._config.kind.is_inside:
            standstill.watch(self._guard)
        self._controller = self._config.kind.build(self._config.settings, surroundings)
        # At first it gets power with the bench, and hears it boot; later it was without.
        return received if self._starts == 1 else ()

    def _serve(self, frames: Sequence[Frame]) -> Sequence[TimedFrame]:
        """Have the bench answer frames while its time stands still; return what has come since."""
        own = [self._to_bench(frame) for frame in frames]
        self._own += own
        self._session.serve(own)
        received, self._inbox = self._inbox, []
        return received

    def _hear(self, received: Sequence[Frame], sent: Sequence[Frame], now: int) -> None:
        """Keep what passes on its buses, but for its own frames."""
        own, places, inbox = self._own, self._places, self._inbox
        time: Any = now - self._skipped  # made an object once for all frames
        for frame in received:
            if own and frame is own[0]:  # as a rule in the order in which they were sent
                del own[0]
            elif own and frame in own:
                own.remove(frame)
            elif frame.bus in places and not frame.fd:  # whose CAN is classical
                inbox.append(make_timed(TimedFrame, (time, self._to_own(frame))))
        is_on_all = self._is_on_all
        for frame in sent:
            if is_on_all:
                inbox.append(make_timed(TimedFrame, (time, frame)))
            elif frame.bus in places:
                inbox.append(make_timed(TimedFrame, (time, self._to_own(frame))))

    def _to_own(self, frame: Frame) -> Frame:
        place = self._places[frame.bus]
        return frame if place == frame.bus else frame._replace(bus=place)

    def _to_bench(self, frame: Frame) -> Frame:
        """Return a frame with the number of its bus on the bench.

        Raises:
            ControllerError: the controller has no such bus.
        """
        if not 0 <= frame.bus < len(self._numbers):
            wrong = f"the controller sent on its bus {frame.bus}, but has {len(self._numbers)}"
            raise ControllerError(f"{self.place}{wrong}")
        number = self._numbers[frame.bus]
        return frame if number == frame.bus else frame._replace(bus=number)


class Desks:
    """All controllers of a session, in the order of their names.

    Args:
        configs: of the controllers.
        session: of the bench, before its first tick.
        bench: configuration of the bench.
        scratch: an empty folder, which stays the caller's.
        values: the parameters of a scenario, in their own units.

    Attributes:
        desks: of each controller.

    Raises:
        ConfigError: the buses are of copper, and a kind's SYNC is its clock.
    """

    def __init__(
        self,
        configs: Sequence[ControllerConfig],
        session: Session,
        bench: BenchConfig,
        scratch: Path,
        values: Mapping[str, float] | None = None,
    ) -> None:
        self.desks = [
            Desk(config, session, bench, scratch / config.name, values or {}, self._farewell)
            for config in sorted(configs, key=attrgetter("name"))
        ]
        if session.bench.medium is not None and any(each.kind.is_clock for each in configs):
            raise ConfigError(
                "[bus.wire]: a controller whose SYNC is its clock gives frames no time to pass; "
                "leave the table out, or give a controller of another kind"
            )
        self._session, self._scratch = session, scratch
        self._tick, self._last, self._skipped = bench.tick_ns, 0, 0
        self._turns = Turns()
        session.sources.append(self._live)
        session.preparations.append(self.prepare)
        for desk in self.desks:
            session.switches[desk.name] = partial(self.switch, desk)

    @property
    def ending(self) -> str:
        """The words on controllers that have come to their end by themselves; empty for none."""
        ended = [desk for desk in self.desks if desk.ending]
        return "; ".join(f"{desk.place}the controller ended: {desk.ending}" for desk in ended)

    @property
    def have_begun(self) -> bool:
        """Return True unless one runs that has not begun its work yet."""
        return all(desk.has_begun for desk in self.desks)

    def switch(self, desk: Desk, position: str) -> None:
        """Turn a controller on or off; where it is so already, nothing changes.

        Args:
            desk: of the controller.
            position: of the switch, a `Power`.
        """
        power = Power(position)
        if power is not Power.START:
            desk.switch_off(at_once=True)
        if power is not Power.KILL and not desk.is_running:
            desk.is_due = True

    def branch(self) -> Callable[[bool], None]:
        """Make all ready for a copy of this process; see `BranchingController`."""
        each = [controller.branch() for controller in self._branching()]

        def go_on(is_copy: bool) -> None:
            for settle in each:
                settle(is_copy)

        return go_on

    @property
    def pids(self) -> set[int]:
        """The processes of controllers that can branch."""
        return {controller.pid for controller in self._branching() if controller.pid}

    def _branching(self) -> list[BranchingController]:
        return [found for desk in self.desks if (found := desk.branching()) is not None]

    def prepare(self) -> None:
        """Start those that start with the first tick, before time passes."""
        for desk in self.desks:
            desk.prepare()

    def leave_off(self) -> None:
        """Leave all off until they are started."""
        for desk in self.desks:
            desk.is_due = False

    def report(self) -> str:
        """The end of what each controller has printed."""
        tails = ((desk.name, desk.tail()) for desk in self.desks)
        return "\n".join(f"{name}:\n{tail}" for name, tail in tails if tail)

    def close(self) -> None:
        """End all controllers; a second call does nothing."""
        self._turns.end()
        for desk in reversed(self.desks):
            desk.switch_off()

    def _farewell(self) -> None:
        """End the others, and what watches the bench, where one never comes back."""
        for desk in self.desks:
            if not desk.kind.is_inside:
                desk.switch_off(at_once=True)
        for farewell in tuple(self._session.farewells):
            farewell()
        if any(desk.kind.uses_files for desk in self.desks):
            shutil.rmtree(self._scratch, ignore_errors=True)

    def _partners(self) -> list[int]:
        return [desk.partner for desk in self.desks]

    def _live(self, now: int) -> Sequence[Frame]:
        """Let all live until a tick; return what they have sent, by time and name."""
        if not now:  # the nodes boot in that tick
            return ()
        # The plant stands still in ticks that a late loop skips, and so do they.
        self._skipped += max(now - self._last - self._tick, 0) if self._last else 0
        self._last = now
        until = now - self._skipped
        self._turns.take(self._partners)
        if len(self.desks) == 1:
            return [frame for _, frame in self.desks[0].live(until, self._skipped)]
        sent = [each for desk in self.desks for each in desk.live(until, self._skipped)]
        sent.sort(key=_TIME)
        return [frame for _, frame in sent]
