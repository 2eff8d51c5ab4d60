"""The tables ``[plant.NAME]``: the axes, each with the kind of its plant."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from hil_bench.bench.configuration.loop import LoopSection
from hil_bench.bench.configuration.plausibility import check_possible
from hil_bench.bench.configuration.supplies import SuppliesSection
from hil_bench.config.document import Document, read_named_sections
from hil_bench.config.settings import Given, Key, Problems, Settings, read_table
from hil_bench.config.values import describe, text
from hil_bench.errors import ConfigError
from hil_bench.plants.kind import AxisConfig, AxisSettings, PlantKind
from hil_bench.plants.registry import DEFAULT_PLANT, PLANTS

KIND_KEY = Key("kind", text)

NO_PLANT = "none"
"""The kind of a plant that is none: the bench has nodes alone."""

_DEFAULT_AXIS = "axis1"


Axes = Mapping[str, AxisSettings]
"""By name."""


class AxesSection:
    """The plants of a bench.

    Args:
        document: the file.
        loop: with the step of the plants' solvers.
        supplies: those that axes share.
        folder: that relative paths in the file start from.
        problems: where problems are noted.
        default: whether a file without a plant has one default axis; else it has none.

    Attributes:
        supplies: as passed in.
        axes: the table of each axis by its name; one of a kind that is not there is left out.
        records: those of the axes that make physical sense; known once it is resolved.
    """

    def __init__(
        self,
        document: Document,
        loop: LoopSection,
        supplies: SuppliesSection,
        folder: Path,
        problems: Problems,
        *,
        default: bool,
    ) -> None:
        self.axes = _read_axes(document, supplies, folder, problems, default=default)
        self.records: tuple[AxisConfig, ...] = ()
        self._loop, self._problems, self.supplies = loop, problems, supplies

    def resolve(self) -> None:
        """Make the records, and note values that nature does not allow."""
        records = []
        for name, axis in self.axes.items():
            check_possible(axis.settings, axis.kind, self._problems)
            records.append(
                axis.kind.configure(name, axis.settings, self._loop.step_us, self._problems)
            )
        self.records = tuple(record for record in records if record is not None)
        self.supplies.connect(self.records)

    def build(self) -> dict[str, Any]:
        """Return the records of the axes."""
        return {"axes": self.records}

    def tables(self) -> Iterable[Settings]:
        """Return the table of each axis."""
        return (axis.settings for axis in self.axes.values())


def _read_axes(
    document: Document,
    supplies: SuppliesSection,
    folder: Path,
    problems: Problems,
    *,
    default: bool,
) -> dict[str, AxisSettings]:
    sections = read_named_sections(document, "plant", problems)
    if default and not sections:
        sections = {_DEFAULT_AXIS: {}}
    axes = {}
    for name, given in sections.items():
        table = f"plant.{name}"
        if KIND_KEY.name in given and given[KIND_KEY.name].value == NO_PLANT:
            _check_nothing(given, problems)
            continue
        told = {KIND_KEY.name: given.pop(KIND_KEY.name)} if KIND_KEY.name in given else {}
        kind = _find_kind(told, problems)
        if kind is not None:
            said = read_table(table, told, (KIND_KEY,), problems) if told else {}
            settings = read_table(table, given, kind.keys, problems)
            if len(settings) == len(kind.keys):
                settings = kind.derive(supplies.lend(name, kind, settings), problems)
                special = kind.specialise(settings, folder, problems)
                if special is None:
                    problems.raise_any()  # without its quantities nothing else can be checked
                kind = special or kind
            axes[name] = AxisSettings(kind, said | settings)
    return axes


def _check_nothing(given: Mapping[str, Given], problems: Problems) -> None:
    """Note what is said of a plant that is none."""
    for key, (_, _, place) in given.items():
        if key != KIND_KEY.name:
            problems.add(
                place, f'there is no plant to have it; leave it out, or kind = "{NO_PLANT}"'
            )


def _find_kind(told: Mapping[str, Given], problems: Problems) -> PlantKind[Any] | None:
    if not told:
        return DEFAULT_PLANT
    given = told[KIND_KEY.name]
    try:
        kind = PLANTS.find(given.value) if isinstance(given.value, str) else None
    except ConfigError as error:
        problems.add(given.place, error)
        return None
    if kind is None:
        known = ", ".join(f'"{name}"' for name in (*PLANTS.names(), NO_PLANT))
        problems.add(given.place, f"{describe(given.value)} is unknown; give one of {known}")
    return kind
