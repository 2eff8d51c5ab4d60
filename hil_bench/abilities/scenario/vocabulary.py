"""The names that an expectation may use: signals, states, events and parameters."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from hil_bench.outside.recording.channels import TIME, Channel

DM1 = "dm1"
EMCY = "emcy"
FRAME = "frame"


@dataclass(frozen=True, slots=True)
class Vocabulary:
    """The names that a bench or a recording knows.

    Attributes:
        signals: the symbol of the SI unit of each signal.
        states: of each signal that is a state, the number of each of its texts.
        nodes: names of the nodes, for ``emcy(NODE)``.
        has_frames: whether ``frame(COB-ID)`` and ``emcy(NODE)`` are known.
        parameters: the SI value of each parameter; its name ends in its unit.
        shared: of each name that stands for several signals, what tells them apart.
        ecus: names of the J1939 devices, for ``dm1(DEVICE)``.
    """

    signals: Mapping[str, str]
    states: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    nodes: tuple[str, ...] = ()
    has_frames: bool = False
    parameters: Mapping[str, float] = field(default_factory=dict)
    shared: Mapping[str, str] = field(default_factory=dict)
    ecus: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """All names that stand for a value."""
        return (*self.signals, *self.states, *self.parameters)


def channel_vocabulary(
    channels: Iterable[Channel], parameters: Mapping[str, float] | None = None
) -> Vocabulary:
    """Return the vocabulary of a recording without states and frames."""
    units = {each.name: each.unit for each in channels if each.name != TIME.name}
    return Vocabulary(units, parameters=dict(parameters or {}))
