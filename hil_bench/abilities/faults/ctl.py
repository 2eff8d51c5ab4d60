"""The faults of a running bench from the shell: the actions of `hil-bench ctl`, and their words."""

import argparse
from collections.abc import Mapping
from typing import Any, Final

from hil_bench.abilities.live.client import FeedClient
from hil_bench.cli.results import print_results
from hil_bench.errors import ConfigError, printable

EXAMPLES = """\
  hil-bench ctl fault freeze position for_s=1
  hil-bench ctl fault offset pressure_a offset_bar=20
  hil-bench ctl clear position                  or the number of a fault, or nothing for all
"""

NOTHING: Final = "fault  none"
"""The line of a bench on which nothing is wrong."""


def state_lines(state: Mapping[str, Any]) -> list[str]:
    """Return the faults in the state of a bench, a line each."""
    faults = state.get("faults", ())
    return [f"fault  {fault['number']}  {fault_text(fault)}" for fault in faults]


def fault_text(fault: Mapping[str, Any]) -> str:
    """Return a fault in words."""
    ends = "" if fault["ends"] is None else f", until {fault['ends']:.3f} s"
    idle = ", has changed nothing so far" if fault["is_idle"] else ""
    return printable(f"{fault['kind']} {fault['target']} since {fault['begins']:.3f} s{ends}{idle}")


def add_actions(add: Any) -> None:  # noqa: ANN401 - the `Add` of its taker
    """Add the actions, each a name, what it does and its line in the help."""
    fault = add("fault", begin_fault, "begin a fault with the next tick")
    fault.add_argument(
        "words",
        nargs="+",
        metavar="WORD",
        help="fault as KIND TARGET [KEY=VALUE ...], as in [[faults]]; without at_s it begins "
        "with the next tick",
    )
    clear = add("clear", clear_faults, "end faults")
    clear.add_argument(
        "faults", nargs="*", metavar="FAULT", help="number, kind or target (default: all)"
    )


def begin_fault(client: FeedClient, args: argparse.Namespace) -> None:
    """Begin a fault and print its number."""
    # Here, since they know all of the configuration, which takes longer than all the rest.
    from hil_bench.abilities.faults.live import fault_fields  # noqa: PLC0415
    from hil_bench.abilities.faults.options import parse_fault  # noqa: PLC0415

    fields = fault_fields(parse_fault(args.words, "fault"), client.hello)
    number = client.request("begin_fault", **fields)
    line = printable(f"fault {number}  {fields['kind']} {fields['target']}")
    print_results(args, [line], {"number": number})


def clear_faults(client: FeedClient, args: argparse.Namespace) -> None:
    """End faults.

    Raises:
        ConfigError: one of them is not there.
    """
    active = client.request("status")["state"]["faults"]
    idle = {fault["number"]: ", which has changed nothing" for fault in active if fault["is_idle"]}
    if not args.faults:
        client.request("clear_fault")
        lines = [f"fault {number} cleared{idle[number]}" for number in idle]
        print_results(args, [*lines, "all faults cleared"], {"cleared": None})
        return
    numbers: list[int] = []
    for word in args.faults:
        found = [
            fault["number"]
            for fault in active
            if word in {str(fault["number"]), fault["kind"], fault["target"]}
        ]
        if not found:
            known = "; ".join(f"{each['number']} {fault_text(each)}" for each in active)
            raise ConfigError(f"clear {word}: there is no such fault; active: {known or 'none'}")
        numbers += [number for number in found if number not in numbers]
    for number in numbers:
        client.request("clear_fault", number=number)
    lines = [f"fault {each} cleared{idle.get(each, '')}" for each in numbers]
    print_results(args, lines, {"cleared": numbers})
