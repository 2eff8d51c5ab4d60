"""The seam between a bench and what controls it: the bench owns time, a controller lives until t.

A `ControllerKind` makes controllers of one kind, such as a C library or the program that is
flashed, of the keys of a ``[controller]`` table. See docs/firmware.md.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol, runtime_checkable

from hil_bench.bench.configuration import BenchConfig
from hil_bench.canopen_device.frame import Frame
from hil_bench.config.settings import Key


class TimedFrame(NamedTuple):
    """A frame on a bus, and when.

    Attributes:
        time: bench time [ns].
        frame: its `bus` counts the controller's own buses, from 0.
    """

    time: int
    frame: Frame


make_timed: Final[Callable[[type[TimedFrame], tuple[int, Frame]], TimedFrame]] = tuple.__new__
"""Return a frame with its time, `make_timed(TimedFrame, fields)`: quicker than `TimedFrame`."""


class ControllerEnd(Exception):  # noqa: N818 - no error: a program may come to its end
    """The controller has come to its end in good order; the words say how.

    Args:
        words: how it ended; empty where there is nothing to say.
        sent: what it had still sent.
    """

    def __init__(self, words: str = "", sent: Sequence[TimedFrame] = ()) -> None:
        super().__init__(words)
        self.sent = sent


class Controller(Protocol):
    """A controller on the bench's clock.

    Whatever it cannot go on after is a `ControllerError`, whose lines say what and where.

    Attributes:
        has_begun: False while it knows that it has not begun its work yet. A run that is too short
            for that is none.
    """

    has_begun: bool

    def advance(self, until: int, received: Sequence[TimedFrame]) -> Sequence[TimedFrame]:
        """Live until a moment and return what it has sent, each with its time.

        Args:
            until: bench time, later than in the call before [ns].
            received: what has come on its buses since the call before, in order; none of its own.

        Raises:
            ControllerEnd: it has ended by itself, as it should.
            ControllerError: it has failed.
        """

    def reset(self) -> None:
        """Take its power away at once; a `close` follows."""

    def tail(self) -> str:
        """The end of what it has printed, for messages and reports; empty for nothing."""

    def close(self) -> None:
        """End it; a second call does nothing. No process and no file of it stays."""


@runtime_checkable
class PreparingController(Controller, Protocol):
    """A controller with work to do before bench time begins."""

    def prepare(self) -> None:
        """Do what needs no bench time; called at most once, before the first `advance`.

        What fails here, `advance` says.
        """


@runtime_checkable
class AlternatingController(Controller, Protocol):
    """A controller in a process that sleeps while the bench works, and the bench while it does.

    Attributes:
        partner: that process; 0 for none.
    """

    partner: int


@runtime_checkable
class BranchingController(Controller, Protocol):
    """A controller of a kind that `can_branch`, in a process of its own.

    Attributes:
        pid: of its process; 0 where it has none.
    """

    pid: int

    def branch(self) -> Callable[[bool], None]:
        """Make ready for a copy of this process by `os.fork`.

        Returns:
            A function that both call behind it, with True in the copy.
        """


class Surroundings(NamedTuple):
    """The surroundings in which a controller is built.

    Attributes:
        name: of the controller, as in ``[controllers.NAME]``.
        place: how messages name its table.
        folder: from which relative paths count.
        scratch: an empty folder of its own, which goes when the run is over; not there for a kind
            that uses no files.
        buses: the names of its buses, in the order in which its frames count them.
        config: of the bench.
        values: the parameters of the scenario by their names, in their own units.
        tick_ns: time from one `advance` to the next [ns].
        serve: within `advance`, has the bench answer frames while its time stands still; returns
            what has come since. Only for a kind whose SYNC is its clock.
    """

    name: str
    place: str
    folder: Path
    scratch: Path
    buses: tuple[str, ...]
    config: BenchConfig
    values: Mapping[str, float]
    tick_ns: int
    serve: Callable[[Sequence[Frame]], Sequence[TimedFrame]] = lambda _: ()

    def filled(self, word: str) -> str:
        """A word of a command line with ``{parameter}`` replaced by its value."""
        for name, value in self.values.items():
            word = word.replace("{" + name + "}", f"{value:.12g}")
        return word


class ControllerKind(ABC):
    """A kind of controller.

    Attributes:
        name: as in ``kind = "NAME"`` of ``[controller]``.
        summary: one line on what it runs.
        keys: of its table, beside ``kind`` and ``buses``.
        uses_files: whether it needs `Surroundings.scratch`; without it no folder is made.
        is_clock: whether its SYNC is its clock, so that it needs `Surroundings.serve`, and buses
            on which frames take no time.
        can_branch: whether a run that it drives may be copied with its process: all of its
            controllers' state is there, or each is a `BranchingController`; and they take nothing
            of the parameters but what ``{parameter}`` names in its table.
        is_native: whether it runs machine code in the bench's process, which a crash may end.
        is_inside: whether its code runs in the bench's thread, which waits until it comes back; its
            tables have the key ``patience_s`` then.
    """

    name: str
    summary: str
    keys: tuple[Key, ...] = ()
    uses_files: bool = True
    is_clock: bool = False
    can_branch: bool = False
    is_native: bool = False
    is_inside: bool = False

    @abstractmethod
    def problems(self, settings: Mapping[str, Any], folder: Path) -> Sequence[str]:
        """Return the faults of a table that can be known before a run, a line each, key first.

        Args:
            settings: its values by key, in SI.
            folder: from which relative paths count.
        """

    @abstractmethod
    def build(self, settings: Mapping[str, Any], surroundings: Surroundings) -> Controller:
        """Return a controller that has not begun yet.

        Args:
            settings: the values of its table by key, in SI.
            surroundings: where it lives.

        Raises:
            ConfigError: a file is not what it should be.
            ControllerError: it cannot be started.
        """
