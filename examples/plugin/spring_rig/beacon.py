"""A table of `bench.toml` of one's own: a frame at a period, as a safety controller sends.

[beacon]
can_id = 0x77F
period_ms = 50
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hil_bench.ability import Ability
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.configuration.records import Part
from hil_bench.bench.session import Session
from hil_bench.canopen_device.frame import Frame
from hil_bench.config.document import Document, read_section
from hil_bench.config.settings import (
    CLOCK_MILLISECOND,
    Key,
    Problems,
    Settings,
    convert,
    read_table,
)
from hil_bench.config.values import integer

KEYS = (
    Key("can_id", integer(1, 0x7FF), example="0x77F"),
    Key("period_ms", integer(1, 60_000), 50, CLOCK_MILLISECOND, "period"),
)


@dataclass(frozen=True, slots=True)
class Beacon(Part):
    """A frame at a period: `config.of(Beacon)`.

    Attributes:
        can_id: identifier of its frame, which has no data.
        period: time between two [ns].
    """

    can_id: int
    period: int

    @property
    def lines(self) -> tuple[str, ...]:
        """The line on it at the start of a run."""
        return (f"beacon 0x{self.can_id:03X} each {self.period / 1e6:g} ms",)

    @contextmanager
    def attached(self, session: Session, config: BenchConfig) -> Iterator[None]:
        """Send on the first bus of a session while that lasts."""
        session.sources.append(self.send)
        yield

    def send(self, now: int) -> Sequence[Frame]:
        """Return its frame where that is due."""
        return () if now % self.period else (Frame(self.can_id),)


class BeaconSection:
    """The reader of the table; it is made only where a file has it."""

    def __init__(
        self, document: Document, buses: tuple[str, ...], base: Path, problems: Problems
    ) -> None:
        given = read_section(document, "beacon", problems)
        self._settings = read_table("beacon", given, KEYS, problems)

    def resolve(self) -> None:
        """Take nothing from other sections."""

    def build(self) -> Mapping[str, Any]:
        """Return the record under the table's name."""
        return {"beacon": Beacon(**convert(self._settings, KEYS))}

    def tables(self) -> Iterable[Settings]:
        """Return the table as a person would write it."""
        return [self._settings]


BEACON = Ability("beacon", tables={"beacon": "spring_rig.beacon:BeaconSection"})
