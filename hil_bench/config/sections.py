"""Sections: what a file says of one feature, as an object that loading asks in three steps.

Whoever loads a file makes all sections, which reads their tables, then lets each resolve what it
takes from the others, then has each build its part of the record. So loading knows no feature.
"""

from collections.abc import Iterable, Sequence
from itertools import chain
from typing import Any, Protocol

from hil_bench.config.settings import Problems, Settings


class Section(Protocol):
    """One feature of a configuration file; its tables are read when it is made."""

    def resolve(self) -> None:
        """Fill in what follows from other sections, and note what does not fit together."""

    def build(self) -> dict[str, Any]:
        """Return the attributes of the record of the whole that this section fills."""

    def tables(self) -> Iterable[Settings]:
        """Return its tables as a person would write them."""


def build_sections(sections: Sequence[Section], problems: Problems) -> dict[str, Any]:
    """Return all attributes of the record that sections describe.

    A `ConfigError` has the problems of a step, a line each: no section resolves what was read
    wrong, and none builds what does not fit together.

    Args:
        sections: as they were read.
        problems: what they have noted so far, and go on noting.
    """
    problems.raise_any()
    for section in sections:
        section.resolve()
    problems.raise_any()
    parts = [section.build() for section in sections]
    problems.raise_any()
    used = chain.from_iterable(table.values() for each in sections for table in each.tables())
    return {"settings": tuple(used)} | {name: part[name] for part in parts for name in part}
