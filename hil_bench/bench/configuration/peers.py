"""Tables of devices beside the CANopen nodes, which abilities read before the nodes."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

from hil_bench.config.document import Document
from hil_bench.config.settings import Settings


class OtherDrive(NamedTuple):
    """A driver of an axis that is no CANopen node.

    Attributes:
        what: how messages call it.
        place: of its axis.
        axis: that it commands.
    """

    what: str
    place: str
    axis: str | None


class PeerSection(Protocol):
    """The section of such a table.

    Attributes:
        is_given: whether the file has such devices, right or wrong.
    """

    is_given: bool

    @staticmethod
    def needs_axis(document: Document) -> bool:
        """Return True if a device of the file's table is connected to a plant."""

    @property
    def buses(self) -> Mapping[str, str]:
        """The bus of each device by its name."""

    def drives(self) -> Iterator[OtherDrive]:
        """Yield what commands axes."""

    def resolve(self) -> None:
        """As `Section.resolve`."""

    def build(self) -> dict[str, Any]:
        """As `Section.build`."""

    def tables(self) -> Iterable[Settings]:
        """As `Section.tables`."""


PeerSections = Mapping[str, PeerSection]
"""The sections by the names of their tables."""


def places_of(peers: PeerSections) -> dict[str, str]:
    """Return the bus of each device by its place, as ``j1939.joystick``."""
    return {
        f"{table}.{name}": bus
        for table, section in peers.items()
        for name, bus in section.buses.items()
    }


def drives_of(peers: PeerSections) -> Sequence[OtherDrive]:
    """Return everything of such devices that commands axes."""
    return [drive for section in peers.values() for drive in section.drives()]
