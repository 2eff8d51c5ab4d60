"""`hil-bench monitor --explain`: what is wrong on a bus, as it comes."""

import argparse
import json
import sys
import time

from hil_bench.abilities.eyes.dbc_words import DbcMessages
from hil_bench.abilities.eyes.explain.explain import Explainer
from hil_bench.abilities.eyes.explain.live import Change, LiveFindings
from hil_bench.abilities.eyes.verbs.explain import (
    explanation_content,
    explanation_lines,
    finding_content,
)
from hil_bench.abilities.eyes.verbs.eyes_arguments import known_ecus, known_nodes
from hil_bench.abilities.eyes.verbs.listening import heard, open_listener
from hil_bench.bench.configuration.records import BenchConfig
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import plain, print_lines
from hil_bench.outside.bits import USUAL_BITRATE
from hil_bench.outside.transports.listener import loss_words


def explain_bus(args: argparse.Namespace, config: BenchConfig) -> int:
    """Listen until the time is over or somebody interrupts; print causes as they come.

    At the end stands what `hil-bench explain` says of the same frames.
    """
    bitrate = config.bus.bitrate or USUAL_BITRATE
    known, ecus = known_nodes(args, config), known_ecus(args, config)
    explainer = Explainer(known, bitrate, ecus, config.bus.speedup)
    say = DbcMessages(args.dbc).explain
    live, last = LiveFindings(explainer), time.monotonic_ns()

    def look() -> None:
        for change in live.look(explainer.now + time.monotonic_ns() - last):
            _show(args, change)

    with open_listener(config.bus) as listener:
        for logged in heard(listener, args.duration, look):
            explainer.take(logged)
            last = time.monotonic_ns()
            look()
        frames = listener.frames
        heading = [f"{frames} frames on {listener.description}", *loss_words(listener.losses)]
    if not args.quiet:
        print(", ".join(heading), file=sys.stderr)
    found = explainer.finish()
    if args.json:
        print(json.dumps(plain(explanation_content(found)), allow_nan=False), flush=True)
    else:
        print_lines(args, *explanation_lines(found, bitrate, say))
    if not frames:
        return ExitCode.INCONCLUSIVE
    return ExitCode.CHECK_FAILED if found.findings else ExitCode.DONE


def _show(args: argparse.Namespace, change: Change) -> None:
    now, finding = change.now * 1e-9, change.finding
    if args.json:
        content = {"now": now, "is_gone": change.is_gone, **finding_content(finding)}
        print(json.dumps(plain(content), allow_nan=False), flush=True)
    else:
        gone = "no longer: " if change.is_gone else ""
        print_lines(args, f"{now:10.3f} s  {gone}{finding.cause.title}: {finding.text}")
