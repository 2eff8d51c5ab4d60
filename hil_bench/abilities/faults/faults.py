"""The faults of a bench: `bench.faults.freeze("pressure_a")`.

Each kind of fault is a verb, which makes one fault and returns it. It begins with the next tick, or
`at` a bench time; it lasts until it is cleared, or for `duration`::

    with bench.faults.freeze("pressure_a"):            # for the block
        bench.run(0.5)
    fault = bench.faults.offset("pressure_a", 20e5)    # until fault.clear()
    bench.faults.silence("valve", at=2.0, duration=1.0)

Amounts and times are in SI. Whatever makes no sense is refused with a `ConfigError`.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from hil_bench.abilities.faults.checks import check_ahead
from hil_bench.abilities.faults.fault import Fault, FaultSchedule
from hil_bench.abilities.faults.kind import FaultKind, Site
from hil_bench.abilities.faults.line import Line, Receiver
from hil_bench.abilities.faults.points import NODES, PLANTS, Board, FaultPoints, Places
from hil_bench.abilities.faults.registry import find_fault_kind, missing_defect
from hil_bench.abilities.faults.verbs import Verbs
from hil_bench.canopen_device.agenda import NEVER
from hil_bench.devices.measurement.low_pass import random_stream
from hil_bench.errors import ConfigError

if TYPE_CHECKING:
    from numpy.random import Generator

_NOWHERE: Any = SimpleNamespace(begins=[], holds=[], finishes=[])


class Faults(FaultSchedule, Verbs[Fault]):
    """The faults of one bench.

    Args:
        points: the targets of faults.
        places: where they act in a tick, those of the bench that this is to join; without them,
            nowhere.
        tick_ns: time between two ticks [ns].
        seed: of the random faults.

    Attributes:
        points: as passed in.
        lines: connections that have or had a fault, by node; a new object whenever one comes in.
        clock: returns the bench time [s] where somebody sees it.
        of_file: those that the bench's file has.
    """

    lines: Mapping[Receiver, Line]

    def __init__(
        self,
        points: FaultPoints | None = None,
        places: Places | None = None,
        *,
        tick_ns: int = 1_000_000,
        seed: int = 0,
    ) -> None:
        super().__init__()
        self.points = points or FaultPoints()
        self.lines = {}
        self._places: Places = places or _NOWHERE
        self._tick_ns, self._seed = tick_ns, seed
        self._streams: Counter[str] = Counter()
        self._board: Board | None = None
        self.clock: Callable[[], float] = float
        self.of_file: tuple[Fault, ...] = ()

    def join(self, bench: Places) -> None:
        """Begin and end what is due at the beginning of each tick of a bench.

        Before the first fault it has no place in a tick.
        """
        self._board = bench.switchboard
        self._board.lay(self, self.lines)
        bench.events["faults"] = self.events
        if self.due < NEVER:
            bench.begins.append(self._tick)

    def add(self, *of_fault: Any) -> Fault:  # noqa: ANN401 - as in `FaultSchedule.add`
        """Add a fault, as `FaultSchedule.add` does."""
        fault = super().add(*of_fault)
        if self._board is not None and self._tick not in self._places.begins:
            self._places.begins.append(self._tick)
        return fault

    def _tick(self, now: int) -> None:
        if now >= self.due and self._board is not None:
            self.advance(now)
            self._board.lay(self, self.lines)

    def greeting(self) -> dict[str, object]:
        """Return the targets of faults, and the defects, for those who begin to watch."""
        return {"fault_targets": self.targets, "defects": self.defects}

    def state(self, now: int) -> dict[str, object]:
        """Return the faults that are active at `now` [ns], with their times [s]."""
        faults = [
            {
                "number": self.number_of(fault, now),
                "kind": fault.kind,
                "target": fault.target,
                "begins": _seconds(fault.begins),
                "ends": _seconds(fault.ends),
                "is_idle": fault.is_idle,
            }
            for fault in self.active
        ]
        return {"faults": faults}

    def rehearsal(self) -> "Faults":
        """Faults of the same bench to try a schedule on; those that are tried here never begin."""
        return Faults(self.points, tick_ns=self._tick_ns, seed=self._seed)

    @property
    def targets(self) -> dict[str, list[str]]:
        """Names of the fault targets by group: sensors, valves, nodes, plants that wear, ..."""
        found = {group: [*points] for group, points in self.points.groups.items()}
        return found | {PLANTS.name: [name for name, known in self.defects.items() if known]}

    @property
    def defects(self) -> dict[str, list[str]]:
        """Names of the defects that a plant or a supply can have, by its name."""
        return {name: sorted(point.known) for name, point in self.points.of(PLANTS).items()}

    def begin(
        self,
        kind: str,
        target: str,
        /,
        *,
        at: float | None = None,
        duration: float | None = None,
        **values: Any,  # noqa: ANN401 - of the kind
    ) -> Fault:
        """Make a fault of a kind, as its verb does.

        Args:
            kind: its name.
            target: of the fault.
            at: bench time at which it begins [s]; without it, the next tick.
            duration: how long it lasts [s]; without it, until it is cleared.
            values: of the kind, in SI.

        Raises:
            ConfigError: there is no such kind or target, or it cannot have these values.
        """
        found = find_fault_kind(kind)
        if duration == 0 and found.lasts is None:
            right = "leave it out, or give a time above 0"
            raise ConfigError(f"faults: {kind} {target}: duration = 0 is no time; {right}")
        check_ahead(at, self.clock())
        effect = found.make(self._site(found, target), **values)
        return self.add(kind, target, effect, at, found.lasts if duration is None else duration)

    def _site(self, kind: FaultKind, target: str) -> Site:
        """Return the target of a fault.

        Raises:
            ConfigError: there is none of that name.
        """
        known = self.points.groups
        word, names = kind.find_targets(known)
        if target not in names:
            right = f"give one of {', '.join(names)}" if names else "this bench has none"
            wrong = f'there is no {word} "{target}"; {right}'
            raise ConfigError(f"faults: {kind.find_lack(target, known) or wrong}")
        return Site(
            kind,
            target,
            self.points,
            self._places,
            self._tick_ns * 1e-9,
            partial(self._line, target),
            partial(self._stream, target),
            partial(missing_defect, kind, target),
        )

    def _line(self, name: str) -> Line:
        point = self.points.of(NODES)[name]
        if point.device not in self.lines:
            self.lines = {**self.lines, point.device: Line(point.device)}
        return self.lines[point.device]

    def _stream(self, target: str) -> "Generator":
        """Return the random stream of the target's next fault that needs one."""
        self._streams[target] += 1
        return random_stream(self._seed, target, f"fault {self._streams[target]}")


def _seconds(time: int | None) -> float | None:
    return None if time is None else time * 1e-9


def faults_of(bench: Any) -> Faults:  # noqa: ANN401 - a `VirtualBench`
    """Return the faults of a bench in this process."""
    found: Faults = bench.bench.part(Faults)
    found.clock = bench.now
    return found
