"""The option `--modbus` of `hil-bench run`."""

import argparse
from typing import Final

EXAMPLES: Final = {
    "run": """\
  hil-bench run -i socketcan -c vcan0 --modbus
                                       the sensors on Modbus TCP too, on port 5020
"""
}


def add_options(_: argparse.ArgumentParser, often: "argparse._ActionsContainer") -> None:
    """Add `--modbus`."""
    often.add_argument(
        "--modbus",
        action="store_true",
        help="serve the devices on Modbus also if bench.toml has no [modbus]",
    )


def given(args: argparse.Namespace) -> dict[str, object]:
    """Return the arguments of a command line for `load_config`."""
    return {"modbus": True} if getattr(args, "modbus", False) else {}
