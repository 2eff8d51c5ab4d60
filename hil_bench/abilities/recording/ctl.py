"""`hil-bench ctl record`: a recording of a running bench, from a shell."""

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hil_bench.abilities.live.client import FeedClient
from hil_bench.cli.results import print_results
from hil_bench.errors import RecordingError, printable

EXAMPLES = """\
  hil-bench ctl record run.mf4                   and to end it: hil-bench ctl record --stop
"""

NOTHING = ""


def state_lines(state: Mapping[str, Any]) -> list[str]:
    """Return a line of the recording in the state of a bench, where it records."""
    recording = state.get("recording")
    if not recording:
        return []
    return [printable(f"record {recording['path']} since {recording['begins']:.3f} s")]


def add_actions(add: Callable[..., argparse.ArgumentParser]) -> None:
    """Add what begins and ends a recording; see docs/abilities.md."""
    recording = add("record", record, "start or end a recording")
    which = recording.add_mutually_exclusive_group(required=True)
    which.add_argument(
        "file",
        nargs="?",
        type=Path,
        metavar="FILE",
        help="file to write; the suffix gives the format, as in hil-bench run --record",
    )
    which.add_argument(
        "--stop", action="store_true", help="end the recording that ctl record has started"
    )


def record(client: FeedClient, args: argparse.Namespace) -> None:
    """Begin a recording, or end it and print what its file holds.

    Raises:
        RecordingError: the file is not complete.
    """
    if not args.stop:
        path = args.file.absolute()
        begun = client.request("start_recording", path=str(path))
        line = printable(f"{args.file}: recording since {begun['begins']:.3f} s")
        print_results(args, [line], begun)
        return
    found = client.request("stop_recording")
    parts = [f"{found[each]} {each}" for each in ("rows", "frames") if found[each] is not None]
    line = printable(f"{found['path']}: {', '.join(parts)}, until {found['end']:.3f} s")
    print_results(args, [line], found)
    if found["problem"] or found["lost"]:
        lost = f"{found['lost']} messages left out" if found["lost"] else ""
        raise RecordingError("; ".join(filter(None, [found["problem"], lost])))
