"""Routing of received frames to their handlers."""

from typing import Final

from hil_bench.canopen_device.frame import Frame, Handler
from hil_bench.canopen_device.object_dictionary import Variable

_IDENTIFIERS: Final = frozenset({0x1005, 0x1012})
_FIRST_IS_IDENTIFIER: Final = (range(0x1400, 0x1600), range(0x1800, 0x1A00))
_ALL_ARE_IDENTIFIERS: Final = (range(0x1016, 0x1017), range(0x1201, 0x1280), range(0x1301, 0x1341))


def names_identifier(variable: Variable) -> bool:
    """Return True if a write to `variable` may change which identifiers the device receives."""
    index, subindex = variable.index, variable.subindex
    return (
        index in _IDENTIFIERS
        or (subindex == 1 and any(index in indices for indices in _FIRST_IS_IDENTIFIER))
        or (subindex > 0 and any(index in indices for indices in _ALL_ARE_IDENTIFIERS))
    )


class RouteTable:
    """Handlers by identifier, while they are collected.

    Attributes:
        routes: what was added.
    """

    def __init__(self) -> None:
        self.routes: dict[int, Handler] = {}

    def add(self, can_id: int | None, handler: Handler) -> None:
        """Add a handler after the one that is there, for two services may share an identifier.

        An identifier of None, that of a service which is off, has no effect.
        """
        if can_id is None:
            return
        present = self.routes.get(can_id)
        self.routes[can_id] = handler if present is None else _both(present, handler)


def _both(first: Handler, second: Handler) -> Handler:
    def handle(frame: Frame, now: int) -> None:
        first(frame, now)
        second(frame, now)

    return handle
