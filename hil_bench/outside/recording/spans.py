"""Times of a recording with a name, such as those of its faults."""

from typing import NamedTuple


class Span(NamedTuple):
    """A time in which something was otherwise, such as a fault.

    Attributes:
        begin: [s].
        end: [s].
        label: what it was.
    """

    begin: float
    end: float
    label: str
