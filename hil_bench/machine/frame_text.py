"""The frames of a bench in words: whose they are, what they say, and which of them are news."""

from collections import Counter
from collections.abc import Iterator, Sequence

from hil_bench.bench.assembly import load_objects
from hil_bench.bench.configuration import NodeConfig
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.pdo_mapping import PdoMapping
from hil_bench.canopen_device.pdo_parameters import COMMUNICATION_INDICES, PdoParameters
from hil_bench.errors import SdoAbort
from hil_bench.machine.commissioning.decoding import function_of, meaning_of
from hil_bench.outside.recording.logged_frame import LoggedFrame
from hil_bench.session.virtual_bench import VirtualBench

CYCLIC = 5
"""How often an identifier comes before it counts as cyclic."""

_PDO_INDICES = range(0x1400, 0x1C00)
_WORDS = frozenset({0x6040, 0x6041})  # control and status word: what changes there is news
_Key = tuple[int, int]  # bus and identifier


class FrameText:
    """Reads the frames of a bench by the PDOs that its nodes have now.

    Args:
        bench: the bench.
    """

    def __init__(self, bench: VirtualBench) -> None:
        self._pdos: dict[_Key, tuple[str, PdoMapping | None]] = {}
        self._nodes: dict[_Key, str] = {}
        buses = list(bench.config.buses)
        for settings, node in zip(bench.config.nodes, bench.bench.nodes, strict=True):
            bus = buses.index(settings.bus)
            self._nodes[bus, settings.node_id] = settings.name
            for key, pdo in _pdos(settings, node.object_dictionary):
                self._pdos[bus, key] = pdo

    def name(self, frame: Frame) -> str:
        """Return whose frame it is and which, as in "valve TPDO1"; else its identifier's use."""
        if pdo := self._pdos.get((frame.bus, frame.can_id)):
            return pdo[0]
        function, node_id = function_of(frame.can_id)
        if node_id is None:
            return function
        return f"{self._nodes.get((frame.bus, node_id), f'node {node_id}')} {function}"

    def meaning(self, frame: Frame) -> str:
        """Return what a frame says: the values of a PDO, else words."""
        if frame.is_remote:
            return "remote request"
        values = self._values(frame)
        return ", ".join(values.values()) if values else meaning_of(frame.can_id, frame.data)

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
            now = [text for place, text in self._values(logged.frame).items() if place in _WORDS]
            if now != words.get(key, []) or not self._is_cyclic(logged.frame, counts):
                yield logged
            words[key] = now

    def _is_cyclic(self, frame: Frame, counts: Counter[_Key]) -> bool:
        is_kind = _key(frame) in self._pdos or _is_heartbeat(frame)
        return is_kind and counts[_key(frame)] >= CYCLIC

    def _values(self, frame: Frame) -> dict[int, str]:
        """Return name and value of what a PDO carries, by index; empty for any other frame."""
        _, mapping = self._pdos.get((frame.bus, frame.can_id), ("", None))
        if mapping is None or frame.is_remote or len(frame.data) < mapping.length:
            return {}
        mapping.write(frame.data)
        return {
            variable.index: (
                f"{variable.name} 0x{variable.value:04X}"
                if variable.index in _WORDS
                else f"{variable.name} {variable.value:g}"
            )
            for variable in mapping.variables
        }


def _pdos(
    settings: NodeConfig, live: ObjectDictionary
) -> Iterator[tuple[int, tuple[str, PdoMapping | None]]]:
    """Yield identifier, name and mapping of a node's PDOs, read into a dictionary of our own."""
    copy = load_objects(settings)
    for variable in live:
        if variable.index in _PDO_INDICES:
            copy.variable(variable.index, variable.subindex).value = variable.value
    for direction, indices in COMMUNICATION_INDICES.items():
        for index in copy.indices(indices):
            parameters = PdoParameters(copy, index, direction)
            if parameters.can_id is not None:
                name = f"{settings.name} {direction.value}{parameters.number}"
                yield parameters.can_id, (name, _mapping(parameters))


def _mapping(parameters: PdoParameters) -> PdoMapping | None:
    try:
        return parameters.mapping()
    except SdoAbort:  # a master is about to change it
        return None


def _counts(frames: Sequence[LoggedFrame]) -> Counter[_Key]:
    return Counter(_key(logged.frame) for logged in frames)


def _key(frame: Frame) -> _Key:
    return frame.bus, frame.can_id


def _is_heartbeat(frame: Frame) -> bool:
    return function_of(frame.can_id).name in {"heartbeat", "SYNC"} and frame.data != b"\0"
