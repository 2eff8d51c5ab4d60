"""`hil-bench explain`: what went wrong in a log, causes first."""

import argparse
from collections.abc import Callable, Iterator

from hil_bench.abilities.common.progress import (
    Work,
    counted,
    shown_work,
)
from hil_bench.abilities.eyes.dbc_words import DbcMessages, add_dbc_argument
from hil_bench.abilities.eyes.explain.explain import Explanation, explain
from hil_bench.abilities.eyes.explain.finding import Finding
from hil_bench.abilities.eyes.sight import Sight
from hil_bench.abilities.eyes.verbs import eyes_arguments
from hil_bench.abilities.recording.frames import LeftOut, read_frames
from hil_bench.cli.arguments import load_bench_config
from hil_bench.cli.exit_codes import ExitCode, verdict_code
from hil_bench.cli.results import add_json_argument, print_results
from hil_bench.errors import NothingSeenError
from hil_bench.outside.bits import USUAL_BITRATE, bitrate_text

_EXAMPLES = """\
examples:
  hil-bench explain trace.log bench.toml
  hil-bench explain trace.asc --eds 5=vendor.eds -b 250000
  hil-bench explain trace.log bench.toml --json
  hil-bench explain trace.log --dbc vehicle.dbc            frames of others in its words

exit code 1 where something is wrong, 0 where nothing was found, 6 where no frame shows that
CANopen or J1939 is spoken
"""


_CONSEQUENCES = 5
"""Consequences of a cause that are shown."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "explain",
        description="Find what went wrong in a log of a CANopen or J1939 bus, in the order an\n"
        "expert looks: nodes that are missing, double or restart, refused accesses, missing\n"
        "frames; each with its frames and its clause of CiA 301 or SAE J1939.",
        epilog=_EXAMPLES,
    )
    eyes_arguments.add_log_arguments(parser, assumes=False)
    add_dbc_argument(parser, "shown")
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Explain a log.

    Raises:
        NothingSeenError: it has no frames.
    """
    config = load_bench_config(args)
    left_out = LeftOut()
    bitrate = config.bus.bitrate or USUAL_BITRATE
    nodes, ecus = eyes_arguments.known_nodes(args, config), eyes_arguments.known_ecus(args, config)
    frames = read_frames(args.log, left_out, errors=True, buses=len(config.buses))
    with shown_work(args, Work("explain", unit="frames")) as work:
        found = explain(counted(work, frames), nodes, bitrate, ecus, config.bus.speedup)
    if not found.frames:
        eyes_arguments.print_losses(args, left_out)
        raise NothingSeenError(f"{args.log}: has no frames to explain")
    if left_out.dropped:
        lost = f"{left_out.dropped} frames were lost by its recorder; what is missing may be theirs"
        found = found._replace(notes=(*found.notes, lost))
        left_out.dropped = 0  # said once
    lines = explanation_lines(found, bitrate, DbcMessages(args.dbc).explain)
    print_results(args, lines, explanation_content(found))
    eyes_arguments.print_losses(args, left_out)
    return explanation_code(found)


def explanation_code(found: Explanation) -> ExitCode:
    """Return the exit code of an explanation."""
    is_seen = found.is_judged and found.duration > 0.0
    return verdict_code(fails=bool(found.findings), passes=is_seen)


def explanation_lines(
    found: Explanation, bitrate: int, say: Callable[[Sight], Sight] = lambda sight: sight
) -> Iterator[str]:
    """Yield the lines of an explanation.

    Args:
        found: the explanation.
        bitrate: that the load refers to [bit/s].
        say: words a frame by other knowledge, such as a DBC file.

    Yields:
        The lines.
    """
    yield (
        f"{found.frames} frames in {found.duration:.3f} s, {_nodes_text(found)}"
        f"load {found.load:.1%} of {bitrate_text(bitrate)}"
    )
    for number, finding in enumerate(found.findings, 1):
        yield ""
        yield f"{number}. {finding.cause.title}  ({finding.cause.clause})"
        yield f"   {finding.text}"
        for sight in map(say, finding.sights):
            line = f"{sight.now * 1e-9:14.6f}  {sight.frame.can_id:03X}  {sight.name}  {sight.text}"
            yield line.rstrip()
        if finding.unshown:
            yield f"{'':14}  and {finding.unshown} more"
        for effect in finding.consequences[:_CONSEQUENCES]:
            yield f"   so  {effect.cause.title}: {effect.text}"
        if (more := len(finding.consequences) - _CONSEQUENCES) > 0:
            yield f"   so  {more} more"
        yield f"   do  {finding.cause.advice}"
    for note in found.notes:
        yield f"the log: {note}"
    if not found.is_judged:
        yield "not judged by CiA 301: load, silence and error frames are all that was looked at"
    elif not found.findings:
        instant = "" if found.duration > 0.0 else ", but an instant shows no period and no silence"
        yield f"nothing wrong found{instant}"
    if found.unjudged:
        yield f"not judged: {found.unjudged}"


def _nodes_text(found: Explanation) -> str:
    """Return the number of nodes, and of those that were heard; empty without any."""
    count, heard = len(found.nodes), len(found.heard)
    if heard < count:
        return f"{heard} of {count} nodes heard, "
    return f"{count} nodes, " if count else ""


def explanation_content(found: Explanation) -> dict[str, object]:
    """Return an explanation for `--json`."""
    return {
        "frames": found.frames,
        "duration": found.duration,
        "nodes": found.nodes,
        "heard": found.heard,
        "load": found.load,
        "notes": found.notes,
        "languages": found.languages,
        "is_judged": found.is_judged,
        "unjudged": found.unjudged,
        "findings": [finding_content(each) for each in found.findings],
    }


def finding_content(finding: Finding) -> dict[str, object]:
    """Return a finding for `--json`."""
    return {
        "cause": finding.cause.name.lower(),
        "title": finding.cause.title,
        "clause": finding.cause.clause,
        "node": finding.node,
        "time": finding.begin * 1e-9,
        "text": finding.text,
        "advice": finding.cause.advice,
        "count": finding.total or len(finding.sights),
        "consequences": [finding_content(each) for each in finding.consequences],
        "frames": [
            {"time": s.now * 1e-9, "id": s.frame.can_id, "data": s.frame.data.hex(), "text": s.text}
            for s in finding.sights
        ],
    }
