"""The option `--fault` of the verbs that load a bench and let it run."""

import argparse
from collections.abc import Sequence
from typing import Final

from hil_bench.cli.arguments import parse_value
from hil_bench.errors import ConfigError

EXAMPLES: Final = {
    "run": """\
  hil-bench run -i socketcan -c vcan0 --fault freeze pressure_a at_s=10 for_s=2
""",
    "check": """\
  hil-bench check bench.toml --fault freeze pressure_a at_s=2     what --fault would do
""",
}


def add_options(_: argparse.ArgumentParser, often: "argparse._ActionsContainer") -> None:
    """Add `--fault`."""
    often.add_argument(
        "--fault",
        nargs="+",
        action="append",
        default=[],
        metavar="WORD",
        help="fault as KIND TARGET [KEY=VALUE ...], as in 'freeze pressure_a at_s=2 for_s=1'; "
        "repeat it for more faults (docs/faults.md)",
    )


def given(args: argparse.Namespace) -> dict[str, object]:
    """Return the arguments of a command line for `load_config`."""
    return {"faults": [parse_fault(words) for words in getattr(args, "fault", ())]}


def parse_fault(words: Sequence[str], option: str = "--fault") -> dict[str, object]:
    """Return the table of `[[faults]]` that the words of `--fault` stand for.

    Args:
        words: given to it.
        option: how messages name it.

    Raises:
        ConfigError: they are not KIND TARGET [KEY=VALUE ...].
    """
    pairs = [word.partition("=") for word in words[2:]]
    if len(words) < 2 or "=" in "".join(words[:2]) or not all(sign for _, sign, _ in pairs):
        right = "give KIND TARGET [KEY=VALUE ...], as in freeze pressure_a at_s=2"
        raise ConfigError(f"{option} {' '.join(words)}: is no fault; {right}")
    return {
        "kind": words[0],
        "target": words[1],
        **{key: parse_value(value) for key, _, value in pairs},
    }
