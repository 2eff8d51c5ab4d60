"""The tables ``[plant.NAME]``: the axes, each with the kind of its plant."""

from collections.abc import Mapping
from typing import Any

from hil_bench.bench.configuration.plausibility import check_possible
from hil_bench.config.document import Document, read_named_sections
from hil_bench.config.settings import Given, Key, Problems, read_table
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


def read_axes(document: Document, problems: Problems, *, default: bool) -> dict[str, AxisSettings]:
    """Return the axes by their names; one of a kind that is not there is noted and left out.

    Args:
        document: the file.
        problems: where problems are noted.
        default: whether a file without a plant has one default axis; else it has none.
    """
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
                settings = kind.derive(settings, problems)
            axes[name] = AxisSettings(kind, said | settings)
    return axes


def build_axes(axes: Axes, step_us: int, problems: Problems) -> tuple[AxisConfig, ...]:
    """Return the records of the axes; what makes no physical sense is noted and left out.

    Args:
        axes: as they were read.
        step_us: step of the plants' solvers [us].
        problems: where problems are noted.
    """
    records = (
        axis.kind.configure(name, axis.settings, step_us, problems) for name, axis in axes.items()
    )
    return tuple(record for record in records if record is not None)


def check_axes(axes: Axes, problems: Problems) -> None:
    """Note values of the axes' keys that nature does not allow."""
    for axis in axes.values():
        check_possible(axis.settings, axis.kind, problems)


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
