"""A kind of fault: one declaration of its name, its targets, its keys and what it does.

A kind is a function from the target and the values of its keys to an `Effect`::

    @fault_kind(SENSORS, keys=amounts("offset", "amount"))
    def offset(sensor: Site, amount: float) -> Effect:
        \"\"\"Add an offset [Pa or m] to the value of a sensor.\"\"\"
        return SensorEffect(sensor.point(SENSORS), partial(Shifted, amount, 0.0, sensor.tick))

The function is the verb, ``bench.faults.offset("pressure_a", 20e5)``; in files it is
``kind = "offset"``. Those of other distributions are entry points of the group
`hil_bench.faults`; see docs/plugins.md.
"""

import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeVar

from hil_bench.abilities.faults.checks import FaultDirection
from hil_bench.abilities.faults.fault import Effect
from hil_bench.abilities.faults.line import Line
from hil_bench.abilities.faults.points import FaultPoints, Group, Places
from hil_bench.config.settings import Key
from hil_bench.config.values import choice, integer, number
from hil_bench.units import (
    BAR,
    BAR_PER_SECOND,
    DEGREE,
    DEGREE_PER_SECOND,
    MILLIMETRE,
    MILLIMETRE_PER_SECOND,
    ONE,
    PERCENT,
    PERCENT_PER_SECOND,
    SECOND,
    Unit,
)

if TYPE_CHECKING:
    from numpy.random import Generator

P = TypeVar("P")

LARGEST: Final = 1e6
UNITS: Final[Mapping[str, Unit]] = MappingProxyType(
    {"Pa": BAR, "m": MILLIMETRE, "rad": DEGREE, "-": PERCENT}
)
"""In which keys give amounts, by the SI unit of what a sensor measures."""

DIRECTION: Final = Key("direction", choice(FaultDirection))
CAN_ID: Final = Key("can_id", integer(0, 0x1FFFFFFF))
GROWTH: Final = Key("growth_s", number(SECOND, low=0.0, high=LARGEST), 0.0, SECOND, "growth")

_WORDS: Final[Mapping[str, str]] = MappingProxyType(
    {"for_s": "duration", "growth_s": "time to grow", "can_id": "CAN identifier"}
)
"""Words of a page for common keys whose names are not enough."""


@dataclass(frozen=True, slots=True)
class Site:
    """The target of a fault on its bench.

    Attributes:
        kind: of the fault.
        name: of the target.
        points: of the bench.
        places: of a tick, where the fault may act.
        tick: time between two ticks [s].
        line: returns the target's connection to its bus.
        stream: returns the random stream of the target's next fault that needs one.
        lack: returns why it cannot have the fault, given the defects that it can have.
    """

    kind: "FaultKind"
    name: str
    points: FaultPoints
    places: Places
    tick: float
    line: Callable[[], Line]
    stream: Callable[[], "Generator"]
    lack: Callable[[Iterable[str]], str]

    def point(self, group: Group[P]) -> P:
        """Return the point at which the fault acts."""
        return self.points.of(group)[self.name]


class FaultKind(NamedTuple):
    """A kind of fault.

    Attributes:
        name: as in ``kind = "freeze"``, and of its verb.
        groups: the targets that it accepts.
        make: returns the effect on a `Site` with the values of the keys in SI; its docstring is
            the kind's description.
        keys: of ``[[faults]]`` beside the common ones. Keys of one field are one amount in several
            units, of which the one is right that the sensor measures in.
        idle: an amount with which the fault changes nothing; None where each changes something.
        defects: of a plant, which it makes: one, or by the value of the key `chosen_by` one of
            several.
        chosen_by: that key.
        lacks: what a plant without the defect lacks, for messages, as in "has no load to lose".
        lasts: duration where nobody gives one [s]; None until the fault is cleared.
        words: what a page calls its keys, where their names are not enough.
    """

    name: str
    groups: tuple[Group[Any], ...]
    make: Callable[..., Effect]
    keys: tuple[Key, ...] = ()
    idle: float | None = 0.0
    defects: Mapping[str, str] = MappingProxyType({})
    chosen_by: str = ""
    lacks: str = ""
    lasts: float | None = None
    words: Mapping[str, str] = MappingProxyType({})

    @property
    def description(self) -> str:
        """The first line of its docstring."""
        return (inspect.getdoc(self.make) or "").partition("\n")[0]

    def defect(self, values: Mapping[str, Any]) -> str | None:
        """Return the defect that it makes with these values of its keys; None for no defect."""
        return self.defects.get(values[self.chosen_by] if self.chosen_by else "")

    def find_targets(self, known: Mapping[str, Iterable[str]]) -> tuple[str, list[str]]:
        """Return the word for its targets, and their names.

        Args:
            known: the names of all targets of a bench by group.
        """
        names = [name for group in self.groups for name in known.get(group.name, ())]
        return " or ".join(group.word for group in self.groups), list(dict.fromkeys(names))

    def find_lack(self, target: str, known: Mapping[str, Iterable[str]]) -> str:
        """Say why a target of a wider group is none; empty where it is of no such group."""
        return next(
            (
                group.lacks.format(target)
                for group in self.groups
                if group.wider is not None
                and target in known.get(group.wider.name, ())
                and target not in known.get(group.name, ())
            ),
            "",
        )

    @property
    def amounts(self) -> list[Key]:
        """The keys of the amount that has several units; empty where it has no such amount."""
        fields = [key.field for key in self.keys]
        return [key for key in self.keys if key.field and fields.count(key.field) > 1]

    def is_idle(self, key: Key, value: object) -> bool:
        """Return True if a value of a key changes nothing."""
        is_amount = key.unit is not ONE and key is not GROWTH
        return is_amount and self.idle is not None and value == self.idle

    def word(self, key: Key) -> str:
        """Return the words of a page for a key."""
        plain = key.name.removesuffix(key.unit.suffix).replace("_", " ").strip()
        return self.words.get(key.name) or _WORDS.get(key.name) or plain


def fault_kind(
    *groups: Group[Any],
    keys: tuple[Key, ...] = (),
    idle: float | None = 0.0,
    defects: str | Mapping[str, str] = "",
    chosen_by: str = "",
    lacks: str = "",
    lasts: float | None = None,
    words: Mapping[str, str] = MappingProxyType({}),
) -> Callable[[Callable[..., Effect]], FaultKind]:
    """Make a kind of fault of a function, under its name; the arguments are those of `FaultKind`.

    Args:
        groups: the targets that it accepts.
        keys: of ``[[faults]]``.
        idle: an amount that changes nothing.
        defects: which it makes of a plant: a name, or names by the value of `chosen_by`.
        chosen_by: the key that chooses one.
        lacks: what a plant without the defect lacks.
        lasts: duration where nobody gives one [s].
        words: of a page for keys.
    """
    named = ({"": defects} if defects else {}) if isinstance(defects, str) else defects

    def declare(make: Callable[..., Effect]) -> FaultKind:
        return FaultKind(
            make.__name__, groups, make, keys, idle, named, chosen_by, lacks, lasts, words
        )

    return declare


def amounts(name: str, field: str, *, rate: bool = False, low: float = -LARGEST) -> tuple[Key, ...]:
    """Return the keys of an amount in the unit of whatever a sensor measures.

    Args:
        name: of the keys, before the unit.
        field: the parameter of the kind's function.
        rate: whether it is an amount a second.
        low: the least amount.
    """
    units: tuple[Unit, ...] = (BAR, MILLIMETRE, DEGREE, PERCENT)
    if rate:
        units = (BAR_PER_SECOND, MILLIMETRE_PER_SECOND, DEGREE_PER_SECOND, PERCENT_PER_SECOND)
    return tuple(
        Key(name + unit.suffix, number(unit, low=low, high=LARGEST), None, unit, field)
        for unit in units
    )


def percent(
    name: str, field: str, default: float | None = None, example: str = "", high: float = 100.0
) -> Key:
    """Return a key for a share in percent, from 0 up."""
    return Key(name, number(PERCENT, low=0.0, high=high), default, PERCENT, field, example)
