"""The requests about faults of a running bench; the server of the feed reads them, too."""

from typing import Final

from hil_bench.abilities.live.messages import TABLE, TEXT, AddedAction, Field


def _is_number(value: object) -> bool:
    return value is None or (isinstance(value, int) and not isinstance(value, bool))


_COMMANDS = "hil_bench.abilities.faults.commands"

ACTIONS: Final = {
    "begin_fault": AddedAction(
        {"kind": TEXT, "target": TEXT, "arguments": TABLE._replace(is_needed=False)},
        f"{_COMMANDS}:BeginFault",
        "number",
    ),
    "clear_fault": AddedAction(
        {"number": Field(_is_number, "its number, or null for all", is_needed=False)},
        f"{_COMMANDS}:ClearFault",
    ),
}
