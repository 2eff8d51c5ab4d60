"""The kinds of controllers, and the table that names one."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from hil_bench.abilities.controllers.elf.kind import KIND as ELF
from hil_bench.abilities.controllers.fmu.kind import KIND as FMU
from hil_bench.abilities.controllers.library.kind import KIND as LIBRARY
from hil_bench.abilities.controllers.process.kind import KIND as PROCESS
from hil_bench.abilities.controllers.program.kind import KIND as PROGRAM
from hil_bench.abilities.controllers.python.kind import KIND as PYTHON
from hil_bench.abilities.controllers.seam import ControllerKind
from hil_bench.abilities.controllers.standstill import USUAL_PATIENCE
from hil_bench.config.settings import Key, Problems, Setting, convert, read_table
from hil_bench.config.values import find_nearest, number, quote, text, texts
from hil_bench.registry import Registry, find_twice
from hil_bench.units import SECOND

_OWN = {kind.name: kind for kind in (ELF, FMU, LIBRARY, PROCESS, PROGRAM, PYTHON)}

KIND_KEY: Final = Key("kind", text, example='"python"')
COMMON_KEYS: Final = (KIND_KEY, Key("buses", texts, ()), Key("folder", text))
PATIENCE_KEY: Final = Key("patience_s", number(SECOND, low=1.0, high=1e6), USUAL_PATIENCE, SECOND)


def keys_of(kind: ControllerKind) -> tuple[Key, ...]:
    """Return the keys of a kind's table, beside those of all tables."""
    return (*kind.keys, *((PATIENCE_KEY,) if kind.is_inside else ()))


def _find_fault(kind: ControllerKind) -> str:
    """The fault of a kind from elsewhere; empty where there is none."""
    names = [key.name for key in (*COMMON_KEYS, *keys_of(kind))]
    twice = find_twice(names)
    return f"has the key {twice} twice; each needs a name of its own" if twice else ""


CONTROLLERS: Final = Registry(
    "hil_bench.abilities.controllers",
    ControllerKind,  # type: ignore[type-abstract]
    MappingProxyType(_OWN),
    _find_fault,
)
"""All kinds of controllers, those of other distributions too."""


class Chosen(NamedTuple):
    """A controller as its table describes it.

    Attributes:
        kind: of controller.
        settings: the values of its table by key, in SI.
        buses: the names of its buses; empty for all.
        folder: from which its paths count.
        table: as a person would write it.
    """

    kind: ControllerKind
    settings: Mapping[str, Any]
    buses: tuple[str, ...] = ()
    folder: Path = Path()
    table: Mapping[str, Setting] = MappingProxyType({})


def read_controller(
    table: str, given: Mapping[str, object], folder: Path, problems: Problems
) -> Chosen | None:
    """Return the controller of a table with ``kind``; None with a problem noted.

    Args:
        table: its name.
        given: its values.
        folder: from which its relative paths count.
        problems: where they are noted.
    """
    kind = find_kind(table, given, problems)
    if kind is None:
        return None
    own = keys_of(kind)
    keys = (*COMMON_KEYS, *own)
    found = read_table(table, given, keys, problems)
    if len(found) < len(keys):
        return None
    settings = convert(found, own)
    if found["folder"].value is not None:
        folder /= found["folder"].value
    for line in kind.problems(settings, folder):
        key, _, what = line.partition(": ")
        problems.add(problems.place(table, key), what)
    return Chosen(kind, settings, found["buses"].value, folder, found)


def find_kind(table: str, given: Mapping[str, object], problems: Problems) -> ControllerKind | None:
    """Return the kind that a table names; None with a problem noted."""
    named = read_table(
        table, {k: v for k, v in given.items() if k == "kind"}, (KIND_KEY,), problems
    )
    if "kind" not in named:
        return None
    name = named["kind"].value
    kind = CONTROLLERS.find(name)
    if kind is None:
        near = find_nearest(name, CONTROLLERS.names())
        wrong = f"{quote(name)} is no kind of controller; the nearest is {near}"
        problems.add(problems.place(table, "kind"), wrong)
    return kind


def files_of(settings: Mapping[str, object], folder: Path) -> tuple[Path, ...]:
    """Return the files that the values of a controller's table name.

    Args:
        settings: the values by key.
        folder: from which relative paths count.
    """
    words = [word for value in settings.values() for word in _words(value)]
    paths = [folder / name for word in words for name in (word, word.rpartition(":")[0]) if name]
    return tuple(path for path in paths if path.is_file())


def _words(value: object) -> Iterable[str]:
    if isinstance(value, str):
        return (value,)
    return (each for each in value if isinstance(each, str)) if isinstance(value, tuple) else ()
