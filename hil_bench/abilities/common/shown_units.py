"""The units in which people are shown values: one choice for page, terminal, plots and reports.

The choice is the environment variable ``HIL_BENCH_UNITS``, which ``hil-bench --units`` sets: words
such as ``psi`` or ``MPa,in``, or the name of a set. Files that programs read stay in SI.
"""

import argparse
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache, partial
from typing import Final, NamedTuple

from hil_bench import units
from hil_bench.errors import ConfigError
from hil_bench.units import Unit

VARIABLE: Final = "HIL_BENCH_UNITS"
"""The environment variable with the choice."""


class ShownUnit(NamedTuple):
    """A unit as values are shown in it.

    Attributes:
        unit: the unit.
        digits: behind the point.
        least: smallest span of a plot, in this unit, so that noise does not fill it.
    """

    unit: Unit
    digits: int
    least: float

    @property
    def symbol(self) -> str:
        """The unit's symbol."""
        return self.unit.symbol

    def text(self, value: float | None, nothing: str = "-") -> str:
        """Return a value that is given in SI as people read it, without its unit.

        Args:
            value: in SI.
            nothing: stands for one that is not there, or not finite.
        """
        if value is None or not math.isfinite(value):
            return nothing
        return f"{round(self.unit.from_si(value), self.digits) + 0.0:.{self.digits}f}"

    def short(self, value: float) -> str:
        """Return a limit or set-point, given in SI, without zeros at its end, with its unit."""
        return f"{self._bare(value)} {self.symbol}"

    def range_text(self, low: float, high: float) -> str:
        """Return two limits, given in SI, as in ``10 to 190 mm``."""
        return f"{self._bare(low)} to {self.short(high)}"

    def _bare(self, value: float) -> str:
        return f"{round(self.unit.from_si(value), 9) + 0.0:.6g}"


_Choices = Mapping[str, Mapping[str, ShownUnit]]

QUANTITIES: Final[Mapping[str, _Choices]] = {
    "pressure": {
        "bar": {
            "Pa": ShownUnit(units.BAR, 1, 2.0),
            "Pa/s": ShownUnit(units.BAR_PER_SECOND, 1, 2.0),
        },
        "MPa": {
            "Pa": ShownUnit(units.MEGAPASCAL, 3, 0.2),
            "Pa/s": ShownUnit(units.MEGAPASCAL_PER_SECOND, 3, 0.2),
        },
        "psi": {
            "Pa": ShownUnit(units.PSI, 0, 30.0),
            "Pa/s": ShownUnit(units.PSI_PER_SECOND, 0, 30.0),
        },
    },
    "length": {
        "mm": {
            "m": ShownUnit(units.MILLIMETRE, 2, 1.0),
            "m/s": ShownUnit(units.MILLIMETRE_PER_SECOND, 1, 2.0),
        },
        "in": {
            "m": ShownUnit(units.INCH, 4, 0.05),
            "m/s": ShownUnit(units.INCH_PER_SECOND, 3, 0.1),
        },
        "m": {
            "m": ShownUnit(units.METRE, 5, 0.001),
            "m/s": ShownUnit(units.METRE_PER_SECOND, 4, 0.002),
        },
    },
    "flow": {
        "l/min": {
            "m³/s": ShownUnit(units.LITRE_PER_MINUTE, 2, 0.5),
            "m³": ShownUnit(units.LITRE, 3, 0.1),
        },
        "gpm": {
            "m³/s": ShownUnit(units.US_GALLON_PER_MINUTE, 3, 0.1),
            "m³": ShownUnit(units.US_GALLON, 3, 0.03),
        },
    },
    "angle": {
        "rev": {"rad": ShownUnit(units.REVOLUTION, 4, 0.01)},
        "deg": {"rad": ShownUnit(units.DEGREE, 2, 1.0)},
        "rad": {"rad": ShownUnit(units.RADIAN, 4, 0.02)},
    },
    "speed of rotation": {
        "rpm": {"rad/s": ShownUnit(units.REVOLUTION_PER_MINUTE, 1, 1.0)},
        "deg/s": {"rad/s": ShownUnit(units.DEGREE_PER_SECOND, 1, 5.0)},
        "rad/s": {"rad/s": ShownUnit(units.RADIAN_PER_SECOND, 3, 0.1)},
    },
    "force": {
        "kN": {"N": ShownUnit(units.KILONEWTON, 3, 0.1)},
        "N": {"N": ShownUnit(units.NEWTON, 0, 100.0)},
        "lbf": {"N": ShownUnit(units.POUND_FORCE, 0, 20.0)},
    },
    "torque": {
        "N m": {"N m": ShownUnit(units.NEWTON_METRE, 1, 2.0)},
        "lbf ft": {"N m": ShownUnit(units.POUND_FORCE_FOOT, 1, 2.0)},
    },
}
"""The ways to show each SI unit: by quantity, then by word of the choice; the first is usual."""

SETS: Final[Mapping[str, tuple[str, ...]]] = {
    "metric": (),
    "us": ("psi", "in", "gpm", "deg", "lbf", "lbf ft"),
}
"""Words for several words: what differs from the usual units."""

_FIXED: Final[Mapping[str, ShownUnit]] = {
    "-": ShownUnit(units.PERCENT, 1, 2.0),
    "°C": ShownUnit(units.CELSIUS, 1, 2.0),
    "Hz": ShownUnit(units.HERTZ, 1, 1.0),
}
_OTHER_DIGITS, _OTHER_LEAST = 3, 1e-3

Choice = Mapping[str, str]
"""The word of each quantity."""

USUAL: Final[Choice] = {name: next(iter(words)) for name, words in QUANTITIES.items()}
"""The choice where nobody chooses."""

_QUANTITY_OF = {word: name for name, words in QUANTITIES.items() for word in words}


@lru_cache(maxsize=64)
def parse_choice(text: str) -> Choice:
    """Return the choice of words such as ``psi,in``.

    Raises:
        ConfigError: a word is unknown, or two are of one quantity.
    """
    choice: dict[str, str] = {}
    for word in filter(None, (each.strip() for each in text.split(","))):
        found = SETS.get(word, (word,))
        for each in found:
            name = _QUANTITY_OF.get(each)
            if name is None:
                right = ", ".join((*SETS, *_QUANTITY_OF))
                raise ConfigError(f"units {word!a}: give some of {right}")
            if word not in SETS and name in choice and choice[name] != each:
                raise ConfigError(f"units {text!a}: {choice[name]} and {each} are both of {name}")
            choice.setdefault(name, each)
    return {**USUAL, **choice}


def chosen() -> Choice:
    """Return the choice of the environment.

    Raises:
        ConfigError: a word is wrong.
    """
    try:
        return parse_choice(os.environ.get(VARIABLE, ""))
    except ConfigError as error:
        raise ConfigError(f"{VARIABLE}: {error}") from None


@contextmanager
def choice_of_a_call(text: str) -> Iterator[None]:
    """Choose for the block, and the processes that it starts.

    Yields:
        Nothing.
    """
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = text
    try:
        yield
    finally:
        os.environ.pop(VARIABLE, None)
        if before is not None:
            os.environ[VARIABLE] = before


def shown_unit(symbol: str, choice: Choice | None = None) -> ShownUnit:
    """Return the way to show people a quantity of an SI unit; most as they are.

    Args:
        symbol: of the SI unit.
        choice: None for that of the environment.
    """
    if symbol in _FIXED:
        return _FIXED[symbol]
    for name, word in (chosen() if choice is None else choice).items():
        found = QUANTITIES[name][word].get(symbol)
        if found is not None:
            return found
    return ShownUnit(Unit(symbol, ""), _OTHER_DIGITS, _OTHER_LEAST)


def display_unit(symbol: str) -> Unit:
    """Return the unit in which people are shown a quantity of this SI unit; most as they are."""
    return shown_unit(symbol).unit


def units_content() -> dict[str, object]:
    """Return the whole table for a page, and the choice to begin with."""
    table: dict[str, dict[str, object]] = {
        symbol: {"quantity": "", "shown": {"": _content(shown)}} for symbol, shown in _FIXED.items()
    }
    for name, words in QUANTITIES.items():
        for symbol in next(iter(words.values())):
            shown = {word: _content(each[symbol]) for word, each in words.items()}
            table[symbol] = {"quantity": name, "shown": shown}
    return {
        "quantities": {name: list(words) for name, words in QUANTITIES.items()},
        "sets": {name: parse_choice(name) for name in SETS},
        "chosen": chosen(),
        "units": table,
    }


def _content(shown: ShownUnit) -> dict[str, object]:
    unit, digits, least = shown
    return {"symbol": unit.symbol, "factor": unit.factor, "digits": digits, "least": least}


# The option of the units in which a verb shows values.


def add_units_argument(parser: "argparse._ActionsContainer") -> None:
    """Add --units, which overrides the environment variable for this run and its helpers."""
    parser.add_argument(
        "--units",
        action=_Checked,
        metavar="WORDS",
        help="show values in these units, as in psi,in,gpm or MPa; sets of them are "
        f"{' and '.join(SETS)} (default: {VARIABLE} of the environment, else metric)",
    )


class _Checked(argparse.Action):
    def __call__(
        self,
        _parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[object] | None,
        _option: str | None = None,
    ) -> None:
        """Choose around the verb, by words that are known.

        Raises:
            argparse.ArgumentError: a word is wrong.
        """
        try:
            parse_choice(str(values))
        except ConfigError as error:
            raise argparse.ArgumentError(self, str(error)) from None
        setattr(namespace, self.dest, str(values))
        namespace.around = partial(choice_of_a_call, str(values))


def add_options(_parser: argparse.ArgumentParser, seldom: "argparse._ActionsContainer") -> None:
    """Add --units to `hil-bench run`, for those who watch it."""
    add_units_argument(seldom)
