"""The frames of a bus that a scope marks: EMCY, NMT commands, heartbeats with another state."""

from collections.abc import Iterator, Sequence
from typing import Any

_NMT, _EMCY, _HEARTBEAT = 0x000, range(0x081, 0x100), range(0x701, 0x780)
_MOST_AT_ONCE = 50


class FrameNews:
    """Picks the frames that are news: of a heartbeat, only those with another state."""

    def __init__(self) -> None:
        self._states: dict[tuple[int, int], str] = {}

    def take(self, frames: Sequence[Sequence[Any]]) -> list[Sequence[Any]]:
        """Return those of some frames that are news, the newest of a flood.

        Args:
            frames: as the feed has them: time, bus, way, identifier, data, extended, remote,
                CAN FD.
        """
        return [*self._news(frames)][-_MOST_AT_ONCE:]

    def _news(self, frames: Sequence[Sequence[Any]]) -> Iterator[Sequence[Any]]:
        for frame in frames:
            _, bus, _, identifier, data, is_extended, is_remote, fd = frame
            if is_extended or is_remote or fd:
                continue
            if identifier == _NMT or identifier in _EMCY:
                yield frame
            elif identifier in _HEARTBEAT:
                before = self._states.get((bus, identifier))
                self._states[bus, identifier] = data
                if before is not None and before != data:
                    yield frame
