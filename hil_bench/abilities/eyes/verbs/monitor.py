"""`hil-bench monitor`: what passes a bus, in words, as it comes."""

import argparse
import json
import sys
import time

from hil_bench.abilities.common.arguments import seen_from_bus
from hil_bench.abilities.eyes.dbc_words import DbcMessages, add_dbc_argument
from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.bus import Language
from hil_bench.abilities.eyes.explain.explain import Change, Explainer, LiveFindings
from hil_bench.abilities.eyes.listener import loss_words
from hil_bench.abilities.eyes.verbs import eyes_arguments, listening
from hil_bench.abilities.eyes.verbs.explain import (
    explanation_code,
    explanation_content,
    explanation_lines,
    finding_content,
)
from hil_bench.abilities.eyes.verbs.sight_lines import SightLines
from hil_bench.bench.configuration.records import BenchConfig
from hil_bench.cli.arguments import load_bench_config
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import add_json_argument, plain, print_lines, warn_of
from hil_bench.frame import bits_of
from hil_bench.outside.bits import USUAL_BITRATE, bitrate_text

# `hil-bench monitor --explain`: what is wrong on a bus, as it comes.


def explain_bus(args: argparse.Namespace, config: BenchConfig) -> int:
    """Listen until the time is over or somebody interrupts; print causes as they come.

    At the end stands what `hil-bench explain` says of the same frames.
    """
    bitrate = config.bus.bitrate or USUAL_BITRATE
    known, ecus = eyes_arguments.known_nodes(args, config), eyes_arguments.known_ecus(args, config)
    explainer = Explainer(known, bitrate, ecus, config.bus.speedup)
    say = DbcMessages(args.dbc).explain
    live, last = LiveFindings(explainer), time.monotonic_ns()

    def look() -> None:
        for change in live.look(explainer.now + time.monotonic_ns() - last):
            _show(args, change)

    with listening.open_listener(config.bus) as listener:
        for logged in listening.heard(listener, args.duration, look):
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
    return explanation_code(found) if frames else ExitCode.INCONCLUSIVE


def _show(args: argparse.Namespace, change: Change) -> None:
    now, finding = change.now * 1e-9, change.finding
    if args.json:
        content = {"now": now, "is_gone": change.is_gone, **finding_content(finding)}
        print(json.dumps(plain(content), allow_nan=False), flush=True)
    else:
        gone = "no longer: " if change.is_gone else ""
        print_lines(args, f"{now:10.3f} s  {gone}{finding.cause.title}: {finding.text}")


_EXAMPLES = """\
examples:
  hil-bench monitor -i socketcan -c can0 bench.toml        nodes by name, values with units
  hil-bench monitor -i socketcan -c can0 --eds 5=vendor.eds
  hil-bench monitor -i socketcan -c can0 --hide heartbeat --hide sync --changes
  hil-bench monitor -i socketcan -c can0 --problems        aborts, EMCY, wrong lengths alone
  hil-bench monitor -i socketcan -c can0 --explain         what is wrong, as it comes
  hil-bench monitor -i socketcan -c can0 --json            a JSON object a line
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "monitor",
        description="Print the frames of a bus in words: node, service, objects with values and\n"
        "units, an SDO transfer as one line. Nothing is sent. Nodes without an EDS file are named\n"
        "by their answers.",
        epilog=_EXAMPLES,
    )
    eyes_arguments.add_listening_arguments(parser, assumes=True)
    listening.add_duration_argument(parser, "listen")
    add_dbc_argument(parser, "shown")
    eyes_arguments.add_filter_arguments(parser)
    parser.add_argument(
        "--explain",
        action="store_true",
        help="print what is wrong as it comes, in place of the frames, and at the end what "
        "`hil-bench explain` says; exit code 1 where something is",
    )
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Listen until the time is over or somebody interrupts."""
    listening.check_duration(args)
    config = seen_from_bus(args, load_bench_config(args))
    if args.explain:
        return explain_bus(args, config)
    dbc = DbcMessages(args.dbc)
    decoder = Decoder(
        eyes_arguments.known_nodes(args, config, assumes=True),
        eyes_arguments.known_ecus(args, config),
        dbc.identifiers,
    )
    eyes_arguments.check_nodes(args.node, decoder)
    lines, bits, last = SightLines(args), 0.0, 0
    is_canopen, language = False, Language()
    with listening.open_listener(config.bus) as listener:
        for logged in listening.heard(listener, args.duration, sys.stdout.flush):
            last = logged.now
            if not (is_canopen or logged.frame.is_extended):
                is_canopen = True
                eyes_arguments.say_assumed(args, config)
            bits += bits_of(logged.frame, config.bus.speedup)
            lines.show(map(dbc.explain, language.listen(decoder.take(logged))))
        lines.show(language.listen(decoder.finish()))
        losses = loss_words(listener.losses)
    bitrate = config.bus.bitrate or USUAL_BITRATE
    load = 100.0 * bits / (bitrate * last * 1e-9) if last else 0.0
    if not args.quiet:
        heading = f"{listener.frames} frames in {last * 1e-9:.1f} s on {listener.description}"
        facts = [heading, *losses, f"load {load:.1f} % of {bitrate_text(bitrate)}"]
        print(", ".join(facts), file=sys.stderr)
    if language.is_foreign:
        warn_of([*language.notes(listener.frames)])
    dbc.warn()
    return ExitCode.DONE if listener.frames else ExitCode.INCONCLUSIVE
