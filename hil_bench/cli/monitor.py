"""`hil-bench monitor`: what passes a bus, in words, as it comes."""

import argparse
import math
import sys
import time

from hil_bench.cli.arguments import load_bench_config
from hil_bench.cli.controller_side import seen_from_bus
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.eyes_arguments import (
    add_filter_arguments,
    add_listening_arguments,
    check_nodes,
    known_nodes,
)
from hil_bench.cli.interruption import interruption
from hil_bench.cli.results import add_json_argument
from hil_bench.cli.sight_lines import SightLines
from hil_bench.errors import ConfigError
from hil_bench.eyes.decoder import Decoder
from hil_bench.frame import frame_bits
from hil_bench.outside.transports.bus_load import USUAL_BITRATE, bitrate_text
from hil_bench.outside.transports.listener import Listener
from hil_bench.outside.transports.opening import open_can_bus

_POLL = 0.1

_EXAMPLES = """\
examples:
  hil-bench monitor -i socketcan -c can0 bench.toml        nodes by name, values with units
  hil-bench monitor -i socketcan -c can0 --eds 5=vendor.eds
  hil-bench monitor -i socketcan -c can0 --hide heartbeat --hide sync --changes
  hil-bench monitor -i socketcan -c can0 --problems        aborts, EMCY, wrong lengths alone
  hil-bench monitor -i socketcan -c can0 --json            a JSON object a line
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "monitor",
        description="Print what passes a bus, in words: node, service, objects with values and\n"
        "units, an SDO transfer as one line. Nothing is sent. Nodes without an EDS file are named\n"
        "by what they say of themselves.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_listening_arguments(parser)
    parser.add_argument(
        "--duration",
        type=float,
        default=math.inf,
        metavar="S",
        help="time to listen; until Ctrl-C by default",
    )
    add_filter_arguments(parser)
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Listen until the time is over or somebody interrupts.

    Raises:
        ConfigError: the duration makes no sense.
    """
    if not args.duration > 0.0:
        raise ConfigError(f"--duration {args.duration:g}: more than 0 is right")
    config = seen_from_bus(args, load_bench_config(args))
    decoder = Decoder(known_nodes(args, config))
    check_nodes(args.node, decoder)
    settings = config.bus
    bus, what = open_can_bus(
        settings.interface, settings.channel, settings.bitrate, settings.options
    )
    with bus:
        listener = Listener(bus, what)
        bits, last = _listen(args, listener, decoder)
        losses = listener.losses
    bitrate = settings.bitrate or USUAL_BITRATE
    load = 100.0 * bits / (bitrate * last * 1e-9) if last else 0.0
    if not args.quiet:
        facts = [f"{listener.frames} frames in {last * 1e-9:.1f} s on {what}", *losses]
        facts.append(f"load {load:.1f} % of {bitrate_text(bitrate)}")
        print(", ".join(facts), file=sys.stderr)
    return ExitCode.DONE if listener.frames else ExitCode.INCONCLUSIVE


def _listen(args: argparse.Namespace, listener: Listener, decoder: Decoder) -> tuple[float, int]:
    """Print lines, and return the bits that were on the bus and the time of the last frame [ns]."""
    lines, bits, last = SightLines(args), 0.0, 0
    end = time.monotonic() + args.duration
    with interruption() as interrupted:
        while not interrupted.requested and (left := end - time.monotonic()) > 0.0:
            logged = listener.hear(min(_POLL, left))
            if logged is None:
                sys.stdout.flush()
                continue
            last = logged.now
            bits += frame_bits(len(logged.frame.data), is_extended=logged.frame.is_extended)
            for sight in decoder.take(logged):
                if not args.quiet and (line := lines.of(sight)) is not None:
                    print(line)
    for sight in decoder.finish():
        if not args.quiet and (line := lines.of(sight)) is not None:
            print(line)
    return bits, last
