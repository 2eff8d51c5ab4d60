"""The option of the units in which a verb shows values."""

import argparse
from collections.abc import Sequence

from hil_bench.errors import ConfigError
from hil_bench.shown_units import SETS, VARIABLE, choose, parse_choice


def add_units_argument(parser: "argparse._ActionsContainer") -> None:
    """Add --units, which overrides the environment variable for this run and its helpers."""
    parser.add_argument(
        "--units",
        action=_Checked,
        metavar="WORDS",
        help="show values in these units, as in psi,in,gpm or MPa; sets of them are "
        f"{' and '.join(SETS)} (default: {VARIABLE} of the environment, else metric)",
    )


def apply_units(args: argparse.Namespace) -> None:
    """Choose the units of a parsed command line, where it gives any."""
    given = getattr(args, "units", None)
    if given is not None:
        choose(given)


class _Checked(argparse.Action):
    def __call__(
        self,
        _parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[object] | None,
        _option: str | None = None,
    ) -> None:
        """Store words that are known.

        Raises:
            argparse.ArgumentError: a word is wrong.
        """
        try:
            parse_choice(str(values))
        except ConfigError as error:
            raise argparse.ArgumentError(self, str(error)) from None
        setattr(namespace, self.dest, str(values))
