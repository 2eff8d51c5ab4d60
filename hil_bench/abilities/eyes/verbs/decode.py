"""`hil-bench decode`: a log of frames in words, as channels, as a DBC."""

import argparse
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from hil_bench.abilities.common.arguments import positive
from hil_bench.abilities.common.progress import (
    Work,
    counted,
    shown_work,
)
from hil_bench.abilities.eyes.channels import MOST_LATE, BusChannels, TickRows
from hil_bench.abilities.eyes.dbc_words import DbcMessages, add_dbc_argument
from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.bus import Language
from hil_bench.abilities.eyes.sight import Sight
from hil_bench.abilities.eyes.verbs import eyes_arguments
from hil_bench.abilities.eyes.verbs.sight_lines import SightLines
from hil_bench.abilities.recording.formats import SIGNAL_SUFFIXES
from hil_bench.abilities.recording.frames import LeftOut, read_frames
from hil_bench.abilities.recording.options import recording_code
from hil_bench.abilities.recording.recorder import InlineRecorder, RecordingPlan
from hil_bench.abilities.recording.report import RecordingReport
from hil_bench.bench.configuration import BenchConfig
from hil_bench.cli.arguments import load_bench_config
from hil_bench.cli.exit_codes import Ending
from hil_bench.cli.results import add_json_argument, warn_of
from hil_bench.errors import ConfigError, NothingSeenError
from hil_bench.outside.recording.channels import LoggedFrame

if TYPE_CHECKING:
    from hil_bench.abilities.eyes.known_node import PdoOwner

_LEAST_TICK = 1e-3  # ms
_Seen = Iterable[tuple[int, Sequence[Sight]]]
_Append = Callable[[Sequence[float]], None]
_EXAMPLES = """\
examples:
  hil-bench decode trace.log bench.toml
  hil-bench decode trace.asc --eds 5=vendor.eds --node 5 --changes
  hil-bench decode trace.blf bench.toml --problems
  hil-bench decode trace.log bench.toml -o decoded.mf4     values as channels, in SI
  hil-bench decode trace.log bench.toml -o decoded.csv --tick 1     to be judged
  hil-bench decode trace.log bench.toml --write-dbc bus.dbc     for SavvyCAN, asammdf
  hil-bench decode trace.trc --dbc vendor.dbc      messages that no node explains
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "decode",
        description="Print the frames of a log in words, as 'hil-bench monitor' does of a bus; or\n"
        "write the values of its PDOs and J1939 signals as channels of a recording, or the\n"
        "mapping of its PDOs as a DBC file.",
        epilog=_EXAMPLES,
    )
    eyes_arguments.add_log_arguments(parser, assumes=True)
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="RECORDING",
        help="print nothing: write the values as channels, in SI; .mf4 (with the frames) or .csv",
    )
    parser.add_argument(
        "--tick",
        type=positive,
        metavar="MS",
        help="with -o: a row each MS milliseconds, for 'hil-bench judge' (default: a row a frame)",
    )
    eyes_arguments.add_hold_argument(parser, "with -o: ")
    add_dbc_argument(parser, "shown")
    parser.add_argument(
        "--write-dbc",
        type=Path,
        metavar="FILE.dbc",
        help="print nothing: write a DBC file of the PDOs as they are mapped at the log's end, and "
        "of the J1939 messages of known devices (pip install 'hil-bench[dbc]')",
    )
    eyes_arguments.add_filter_arguments(parser)
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Decode a log.

    Raises:
        NothingSeenError: the log has no frames.
    """
    _check_outputs(args)
    left_out, ending = LeftOut(), Ending(args)
    config = load_bench_config(args)
    decoder = _decoder(args, config)
    eyes_arguments.check_nodes(args.node, decoder)
    language: Language | None = None
    is_writing = _is_writing(args)
    frames = read_frames(args.log, left_out, errors=True, buses=len(config.buses))
    frames = _from_first(frames, dates_alone=is_writing)
    with shown_work(args, Work("decode", unit="frames"), pauses=not is_writing) as work:
        frames = counted(work, frames)
        if is_writing:
            work.stage = "read"
            read = list(frames)
            work.stage = "their values"
            count = _write(args, config, decoder, read, ending)
        else:
            count, language = _print(args, decoder, frames)
    eyes_arguments.print_losses(args, left_out)
    if not count:
        raise NothingSeenError(f"{args.log}: has no frames to decode")
    if language is not None:
        eyes_arguments.say_language(args, config, language, count)
    return ending.code


def _check_outputs(args: argparse.Namespace) -> None:
    """Refuse outputs that cannot be meant.

    Raises:
        ConfigError: it says what would be right.
    """
    if args.output is not None and args.output.suffix.lower() not in SIGNAL_SUFFIXES:
        raise ConfigError(f"-o {args.output}: give a file name that ends in .mf4 or .csv")
    if args.write_dbc is not None and args.write_dbc.suffix.lower() != ".dbc":
        raise ConfigError(f"--write-dbc {args.write_dbc}: give a file name that ends in .dbc")
    if args.tick is not None and args.output is None:
        raise ConfigError("--tick is for the rows of a recording; give it with -o")
    if args.tick is not None and args.tick < _LEAST_TICK:
        raise ConfigError(f"--tick {args.tick:g}: give {_LEAST_TICK:g} ms or more")
    if args.hold is not None and args.output is None:
        raise ConfigError("--hold is for the values of a recording; give it with -o")
    if args.dbc is not None and args.write_dbc is not None:
        raise ConfigError("--write-dbc writes what is known without --dbc; give one of them")


def _print(
    args: argparse.Namespace, decoder: Decoder, frames: Iterator[LoggedFrame]
) -> tuple[int, Language | None]:
    """Print all lines; return the number of frames, and what is spoken by 11-bit identifiers."""
    lines, count = SightLines(args, 1 + max((bus for bus, _ in decoder.nodes), default=0)), 0
    dbc, is_base, language = DbcMessages(args.dbc), False, Language()
    for logged in frames:
        count += 1
        is_base = is_base or not logged.frame.is_extended
        lines.show(map(dbc.explain, language.listen(decoder.take(logged))))
    lines.show(language.listen(decoder.finish()))
    dbc.warn()
    return count, language if is_base else None


def _write(
    args: argparse.Namespace,
    config: BenchConfig,
    decoder: Decoder,
    frames: list[LoggedFrame],
    ending: Ending,
) -> int:
    """Write what is asked for, and return how many frames there were.

    Raises:
        ConfigError: no node or device is known whose messages have values.
    """
    owners: dict[int, PdoOwner] = {}
    groups: set[tuple[int, int]] = set()
    dbc = DbcMessages(args.dbc)
    for logged in frames:
        for sight in decoder.take(logged):
            if sight.message is not None:
                groups.add((sight.frame.bus, sight.message.group))
            dbc.note(sight)
        for owner in decoder.owners(logged.frame):
            owners.setdefault(id(owner.pdo), owner)
    ecus = eyes_arguments.known_ecus(args, config)
    written = []
    if args.write_dbc is not None:
        from hil_bench.abilities.eyes.dbc import write_dbc  # noqa: PLC0415 - an extra

        written.append(f"{write_dbc(args.write_dbc, decoder, ecus)} messages: {args.write_dbc}")
    if args.output is not None:
        dbc.narrow()
        known = (each.narrowed(groups) for each in ecus)
        channels = BusChannels(owners.values(), known, dbc, eyes_arguments.hold_of(args))
        if not channels.channels:
            what = "no PDO of a known node and no J1939 signal of a known device with values"
            if args.dbc is not None:
                what += f", and no message of {args.dbc} with signals"
            right = dbc.hint or "give the bench.toml, --eds N=FILE or --dbc FILE.dbc of this bus"
            raise ConfigError(f"{args.log}: {what}; {right}")
        report = _record(args, channels, _decoder(args, config), frames)
        ending.take(recording_code(report))
        written.append(f"{report.rows} rows, {len(channels.channels)} channels: {args.output}")
    if not args.quiet:
        print("\n".join(written))
    return len(frames)


def _decoder(args: argparse.Namespace, config: BenchConfig) -> Decoder:
    """Return a decoder of the nodes as they are at power-on: it changes those that it has."""
    nodes = eyes_arguments.known_nodes(args, config, assumes=not _is_writing(args))
    ecus = eyes_arguments.known_ecus(args, config)
    return Decoder(nodes, ecus, DbcMessages(args.dbc).identifiers)


def _is_writing(args: argparse.Namespace) -> bool:
    return args.output is not None or args.write_dbc is not None


def _record(
    args: argparse.Namespace, channels: BusChannels, decoder: Decoder, frames: list[LoggedFrame]
) -> RecordingReport:
    """Write a recording, and return what its file holds."""
    recorder = InlineRecorder(RecordingPlan((args.output,), tuple(channels.channels)))
    take = _take_frames if args.tick is None else _take_ticks
    recorder.start()
    try:
        take(args, channels, _recorded(recorder, decoder, frames), recorder.append_row)
    finally:
        recorder.stop()
    return recorder.report


def _recorded(
    recorder: InlineRecorder, decoder: Decoder, frames: Iterable[LoggedFrame]
) -> Iterator[tuple[int, Sequence[Sight]]]:
    """Yield the time of each frame [ns] and what is seen in it, once it is recorded."""
    for logged in frames:
        recorder.append_frames(
            [logged.frame], logged.now, is_received=logged.is_received is not False
        )
        yield logged.now, decoder.take(logged)


def _take_frames(
    _: argparse.Namespace, channels: BusChannels, seen: _Seen, append: _Append
) -> None:
    """Append a row for each frame with values."""
    for now, sights in seen:
        if sum(len(channels.take(sight, now)) for sight in sights):
            append(channels.row(now))


def _take_ticks(
    args: argparse.Namespace, channels: BusChannels, seen: _Seen, append: _Append
) -> None:
    """Append rows at even ticks.

    Raises:
        ConfigError: the log has values that would stand too late, or its time goes back.
    """
    tick, last = round(args.tick * 1e6), 0
    ticks = TickRows(channels, tick)
    for now, sights in seen:
        if now < last - MOST_LATE * tick:
            back = f"its time goes back from {last / 1e9:.6f} to {now / 1e9:.6f} s"
            raise ConfigError(f"{args.log}: {back}; give the log of one clock, in its order")
        last = max(last, now)
        for row in ticks.rows(now):
            append(row)
        for sight in sights:
            ticks.take(sight, now)
    for row in ticks.rows(last + tick):
        append(row)
    if ticks.late > 0:
        warn_of([f"{args.log}: values stand up to {ticks.late / 1e6:.3g} ms late"])


_DATES: Final = 1_000_000_000_000_000_000
"""Times from here on are dates: those since 1970 passed it in 2001 [ns]."""


def _from_first(
    frames: Iterable[LoggedFrame], *, dates_alone: bool = False
) -> Iterator[LoggedFrame]:
    """Count times from the first frame: logs of real buses have the date.

    Args:
        frames: in the order of the log.
        dates_alone: whether to keep the times of a log that has no date but a time 0 of its own.

    Yields:
        The frames.
    """
    first: int | None = None
    for logged in frames:
        if first is None:
            first = 0 if dates_alone and logged.now < _DATES else logged.now
        yield logged._replace(now=logged.now - first)
