"""The frames of a bench in words: whose they are, what they say, and which of them are news."""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Protocol

from hil_bench.abilities.common.identifiers import function_of
from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.frame_words import meaning_of
from hil_bench.abilities.eyes.known_node import nodes_of
from hil_bench.abilities.eyes.values import CONTROL_WORD, STATUS_WORD, Reading
from hil_bench.bench.bench import Bench
from hil_bench.bench.configuration import BenchConfig
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import LoggedFrame

CYCLIC = 5
"""How often an identifier comes before it counts as cyclic."""

_WORDS = frozenset({CONTROL_WORD, STATUS_WORD})
"""What changes there is news."""

_Key = tuple[int, int]  # bus and identifier


class Running(Protocol):
    """A bench that runs."""

    @property
    def config(self) -> BenchConfig:
        """Its configuration."""

    @property
    def bench(self) -> Bench:
        """Its nodes, as they are now."""


class FrameText:
    """Reads the frames of a bench by the PDOs that its nodes have now.

    Args:
        bench: the bench.
    """

    def __init__(self, bench: Running) -> None:
        names = (settings.name for settings in bench.config.nodes)
        live = (node.object_dictionary for node in bench.bench.nodes)
        self._decoder = Decoder(nodes_of(bench.config, dict(zip(names, live, strict=True))))

    def name(self, frame: Frame) -> str:
        """Return the node and name of a frame, as in "valve TPDO1"; else its identifier's use."""
        if owners := self._decoder.owners(frame):
            return f"{owners[0].node.name} {owners[0].pdo.name}"
        function, node_id = function_of(frame.can_id)
        if node_id is None:
            return function
        known = self._decoder.nodes.get((frame.bus, node_id))
        return f"{known.name if known else f'node {node_id}'} {function}"

    def meaning(self, frame: Frame) -> str:
        """Return the meaning of a frame: the values of a PDO, else words."""
        if frame.is_remote:
            return "remote request"
        readings = self._readings(frame)
        return ", ".join(map(str, readings)) or meaning_of(frame.can_id, frame.data)

    def latest(self, frames: Sequence[LoggedFrame]) -> Iterator[LoggedFrame]:
        """Yield the last frame of each identifier that comes cyclically, by identifier."""
        counts = _counts(frames)
        last = {_key(logged.frame): logged for logged in frames}
        for _, logged in sorted(last.items()):
            if self._is_cyclic(logged.frame, counts):
                yield logged

    def news(self, frames: Sequence[LoggedFrame]) -> Iterator[LoggedFrame]:
        """Yield what did not come cyclically, and where a control or status word changed."""
        counts = _counts(frames)
        words: dict[_Key, list[str]] = {}
        for logged in frames:
            key = _key(logged.frame)
            readings = self._readings(logged.frame)
            now = [reading.text for reading in readings if reading.object_index in _WORDS]
            if now != words.get(key, []) or not self._is_cyclic(logged.frame, counts):
                yield logged
            words[key] = now

    def _is_cyclic(self, frame: Frame, counts: Counter[_Key]) -> bool:
        is_kind = bool(self._decoder.owners(frame)) or _is_heartbeat(frame)
        return is_kind and counts[_key(frame)] >= CYCLIC

    def _readings(self, frame: Frame) -> tuple[Reading, ...]:
        """Return the readings in a PDO; empty for any other frame."""
        owners = self._decoder.owners(frame)
        return owners[0].pdo.read(frame.data) if owners and not frame.is_remote else ()


def _counts(frames: Sequence[LoggedFrame]) -> Counter[_Key]:
    return Counter(_key(logged.frame) for logged in frames)


def _key(frame: Frame) -> _Key:
    return frame.bus, frame.can_id


def _is_heartbeat(frame: Frame) -> bool:
    return function_of(frame.can_id).name in {"heartbeat", "SYNC"} and frame.data != b"\0"
