"""The values of a data sheet, and the values derived from them."""

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from hil_bench.config.settings import Origin, Problems, Settings


class Derived(NamedTuple):
    """A physical key that a data sheet determines.

    Attributes:
        key: its name.
        value: in the key's unit.
        sources: the data of the sheet that it follows from.
        typical: what of it is a typical value and no datum; empty for nothing.
        yields: whether a value that the file gives for the key itself comes first.
    """

    key: str
    value: float
    sources: tuple[str, ...] = ()
    typical: str = ""
    yields: bool = False

    @property
    def reason(self) -> str:
        """The origin of the value, in the words of `hil-bench check`."""
        parts = [f"from {join(self.sources)}"] if self.sources else []
        parts += [f"typical: {self.typical}"] if self.typical else []
        return "; ".join(parts)


class Sheet:
    """The keys of an axis as data of a sheet.

    Args:
        settings: of the axis, one for each key.
        problems: where problems are noted.

    Attributes:
        is_sound: whether nothing was refused so far.
    """

    def __init__(self, settings: Settings, problems: Problems) -> None:
        self.settings = settings
        self.is_sound = True
        self._problems = problems

    def has(self, *names: str) -> bool:
        """Return True if somebody has given each of these keys."""
        return all(
            self.settings[name].origin is not Origin.DEFAULT
            and self.settings[name].value is not None
            for name in names
        )

    def given(self, names: Iterable[str]) -> tuple[str, ...]:
        """Return those of these keys that somebody has given."""
        return tuple(name for name in names if self.has(name))

    def number(self, name: str, default: float = math.nan) -> float:
        """Return the value of a key in its own unit; a default where it has none."""
        value = self.settings[name].value
        return default if value is None else float(value)

    def si(self, name: str, default: float = math.nan) -> float:
        """Return the value of a key in SI."""
        value = self.settings[name].value
        return default if value is None else self.settings[name].key.unit.to_si(value)

    def refuse(self, name: str, what: str) -> None:
        """Note what is wrong with a key and what would be right."""
        table = self.settings[name].table
        self._problems.add(self._problems.place(table, name), what)
        self.is_sound = False

    def require(self, cause: str, examples: Iterable[tuple[str, str]]) -> bool:
        """Note which of some keys are missing, each with an example; return whether none is."""
        missing = [(name, example) for name, example in examples if not self.has(name)]
        for name, example in missing:
            right = f"give for example {name} = {example}"
            self.refuse(name, f"missing; {cause} is given and needs it; {right}")
        return not missing

    def take(self, derived: Iterable[Derived]) -> Iterator[Derived]:
        """Yield what fills its key; what the file gives a second time is refused."""
        for each in derived:
            if not self.has(each.key):
                yield each
            elif not each.yields:
                right = f"leave it out, or leave out {join(each.sources)}"
                self.refuse(each.key, f"given twice: {join(each.sources)} says it too; {right}")


def join(names: Iterable[str]) -> str:
    """Return names as a sentence lists them."""
    *rest, last = names
    return f"{', '.join(rest)} and {last}" if rest else last
