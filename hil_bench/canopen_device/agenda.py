"""When a node has something to do: one number, so that an idle tick costs one comparison."""

from typing import Final

NEVER: Final = (1 << 62) - 1
"""A time that does not come [ns]; the largest that compiled code compares without an object."""

MILLISECOND: Final = 1_000_000
"""[ns]"""

INHIBIT_UNIT: Final = 100_000
"""Unit of inhibit times, 100 us [ns] (CiA 301)."""


class Agenda:
    """The earliest time at which one of a node's services wants to be called.

    Whatever gives a service something to do brings `due` forward. It may be earlier than need be,
    never later.

    Attributes:
        due: that time [ns]; 0 for at once.
        whole: the agenda that this one is a part of, as that of one node is of the bench's; it is
            brought forward with it.
    """

    __slots__ = ("due", "whole")

    def __init__(self, whole: "Agenda | None" = None) -> None:
        self.due = NEVER
        self.whole = whole

    def bring_forward(self, time: int) -> None:
        """Be called at `time` [ns] at the latest."""
        agenda: Agenda | None = self
        while agenda is not None:
            if time < agenda.due:  # noqa: PLR1730 - min() costs more than all the rest here
                agenda.due = time
            agenda = agenda.whole
