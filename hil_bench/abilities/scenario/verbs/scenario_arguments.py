"""Arguments that concern a scenario; nothing here imports what plays it."""

import argparse
import math

from hil_bench.errors import ConfigError


def has_bus(args: argparse.Namespace) -> bool:
    """Return True if the command line names a bus."""
    return args.hub is not None or "interface" in args or "channel" in args


def add_parameter_argument(parser: "argparse._ActionsContainer") -> None:
    """Add --set, whose words `read_parameter` reads."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        dest="given",
        help="value of a parameter, in the unit of its name; again for more",
    )


def read_parameter(text: str) -> tuple[str, float]:
    """Return name and value of ``--set``.

    Raises:
        ConfigError: it is not of this form.
    """
    name, _, value = text.partition("=")
    try:
        number = float(value)
    except ValueError:
        raise ConfigError(f"--set {text}: write NAME=NUMBER, as in sag_bar=45") from None
    if not math.isfinite(number):
        raise ConfigError(f"--set {text}: is not finite; give a number")
    return name, number
