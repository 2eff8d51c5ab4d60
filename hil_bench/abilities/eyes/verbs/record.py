"""`hil-bench record`: the frames and decoded values of any bus in a file, without a bench."""

import argparse
from collections.abc import Iterable
from pathlib import Path

from hil_bench.abilities.common.arguments import seen_from_bus
from hil_bench.abilities.eyes.channels import BusChannels
from hil_bench.abilities.eyes.dbc_words import DbcMessages, add_dbc_argument
from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.listener import loss_words
from hil_bench.abilities.eyes.verbs import eyes_arguments, listening
from hil_bench.abilities.recording import options
from hil_bench.abilities.recording.recorder import RecordingPlan
from hil_bench.abilities.recording.recorder_process import RecorderProcess
from hil_bench.cli.arguments import load_bench_config
from hil_bench.cli.exit_codes import Ending, ExitCode
from hil_bench.cli.results import add_json_argument, is_silent, print_results
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import LoggedFrame

_OF_OTHERS = "messages of J1939 from a second sender, whose signals have no channel"
_UNMAPPED = "values of objects that were mapped only later, without a channel"

_UNSTARTED = "nodes send PDOs once an NMT master has started them, as 'hil-bench boot' does"

_EXAMPLES = """\
examples:
  hil-bench record -i socketcan -c can0 bus.log                      frames, until Ctrl-C
  hil-bench record -i socketcan -c can0 bus.mf4 bench.toml           and values as channels
  hil-bench record -i socketcan -c can0 bus.mf4 --eds 5=vendor.eds --duration 60
  hil-bench record -i socketcan -c can0 bus.mf4 --dbc vendor.dbc     signals of its messages
  hil-bench record -i socketcan -c can0 bus.mf4 bench.toml \\
      --trigger "pressure_a.ai_input_process_value_1 > 80 bar"
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "record",
        description="Record a bus: frames in .log, .asc, .blf and .mf4, in .mf4 and\n"
        ".csv also the values of known nodes' PDOs and of known J1939 devices' signals, in SI.\n"
        "Nothing is sent; no bench runs.",
        epilog=_EXAMPLES,
    )
    parser.add_argument("file", nargs="?", type=Path, metavar="FILE", help="the recording")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="the recording, in place of the first FILE",
    )
    eyes_arguments.add_listening_arguments(parser, assumes=False)
    add_dbc_argument(parser, "recorded")
    listening.add_duration_argument(parser, "record")
    eyes_arguments.add_hold_argument(parser)
    options.add_trigger_arguments(parser, "begin recording when a channel is beyond a level")
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Record until the time is over or somebody interrupts.

    Raises:
        ConfigError: an option cannot be meant.
    """
    _settle_file(args)
    listening.check_duration(args)
    options.check_pre_trigger(args)
    config = seen_from_bus(args, load_bench_config(args))
    ecus, dbc = eyes_arguments.known_ecus(args, config), DbcMessages(args.dbc)
    decoder = Decoder(eyes_arguments.known_nodes(args, config), ecus, dbc.identifiers)
    owners = (owner for owners in decoder.pdos.values() for owner in owners)
    channels = BusChannels(owners, ecus, dbc, eyes_arguments.hold_of(args))
    is_values_alone = args.file.suffix.lower() == ".csv"
    if is_values_alone and not channels.channels:
        right = "give bench.toml, --eds N=FILE or --dbc FILE.dbc, or record .mf4 or .log"
        raise ConfigError(f"{args.file}: no values to record, as no node is known; {right}")
    plan = RecordingPlan(
        (args.file,), tuple(channels.channels), trigger=args.trigger, pre_trigger=args.pre_trigger
    )
    plan.check()
    with listening.open_listener(config.bus) as listener:
        if not is_silent(args):
            names = f"{len(channels.channels)} channels" if channels.channels else "frames alone"
            print(
                f"{listener.description}: recording {names} to {args.file}; Ctrl-C ends it",
                flush=True,
            )
        recorder = RecorderProcess(plan)
        recorder.start()
        try:
            values = _take(recorder, listening.heard(listener, args.duration), decoder, channels)
        finally:
            recorder.stop()
        losses, dropped = listener.losses, listener.dropped
    report = recorder.report
    losses.update({_UNMAPPED: channels.missed, _OF_OTHERS: dbc.left_out})
    lines = [*options.report_lines(report), *loss_words(losses)]
    ending = Ending(args)
    ending.take(options.recording_code(report))
    if dropped:
        ending.take(ExitCode.LOST)
    if not listener.frames or (is_values_alone and not values):
        ending.take(ExitCode.INCONCLUSIVE)
    if listener.frames and channels.channels and not values:
        lines.append(f"no value came with {listener.frames} frames; {_UNSTARTED}")
    with ending.going_on():
        print_results(args, lines, {"report": report, **losses})
    return ending.code


def _take(
    recorder: RecorderProcess,
    frames: Iterable[LoggedFrame],
    decoder: Decoder,
    channels: BusChannels,
) -> int:
    """Record frames, and a row for each that has values; return the number of values."""
    values = 0
    for logged in frames:
        recorder.append_frames([logged.frame], logged.now, is_received=True)
        found = sum(len(channels.take(each, logged.now)) for each in decoder.take(logged))
        if found:
            recorder.append_row(channels.row(logged.now))
        values += found
    return values


def _settle_file(args: argparse.Namespace) -> None:
    """Put the recording in `file` and the bench in `config`, by whichever words they came.

    Raises:
        ConfigError: there is no recording, or one word too many.
    """
    if args.output is not None:
        if args.config is not None:
            raise ConfigError(f"-o {args.output}: {args.file} is a second recording; give one")
        args.config = None if args.file is None else str(args.file)
        args.file = args.output
    if args.file is None:
        raise ConfigError("record: give the FILE to write, as in bus.mf4")
