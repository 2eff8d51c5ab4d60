"""`hil-bench identify`: a plant that predicts your cylinder, from recordings."""

import argparse
import json
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from hil_bench.abilities.common import arguments as common
from hil_bench.abilities.common.figure_style import write_figure
from hil_bench.abilities.common.files import whole_file
from hil_bench.abilities.common.progress import Work, shown_work
from hil_bench.abilities.identification.against import compare, describe
from hil_bench.abilities.identification.against import to_json as comparison_to_json
from hil_bench.abilities.identification.bench_file import write_bench
from hil_bench.abilities.identification.errors import Limit, find_exceeded, read_limit
from hil_bench.abilities.identification.identify import Identification, Options, identify
from hil_bench.abilities.identification.ladder import ALIASES, Wish
from hil_bench.abilities.identification.logger import look_through
from hil_bench.abilities.identification.machine import DELAY, DROOP, LAG
from hil_bench.abilities.identification.plot import draw_strokes
from hil_bench.abilities.identification.record import NEEDED, PRESSURES, AxisRecord, join_records
from hil_bench.abilities.identification.report import error_lines, summarise, to_json
from hil_bench.abilities.identification.signs import check_sides, settle_signs
from hil_bench.abilities.identification.verbs.identify_design import (
    Question,
    add_design_arguments,
    check_design_arguments,
    run_design,
)
from hil_bench.abilities.recording.column_map import (
    ColumnMap,
    read_column_map,
    read_mapped,
    take_sensors,
)
from hil_bench.abilities.recording.quantities import check_quantities, find_doubts, make_even
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.bench.configuration import BenchConfig, load_config
from hil_bench.cli.exit_codes import Ending, ExitCode, verdict_code
from hil_bench.cli.results import add_json_argument, print_results, warn_of
from hil_bench.config.settings import Settings
from hil_bench.config.values import find_nearest
from hil_bench.errors import ConfigError, about_file, require_extra
from hil_bench.outside.recording.channels import Recording
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_bench.plants.hydraulic_cylinder.model import Model, PlantOptions, PlantParameters
from hil_bench.units import BAR, MILLIMETRE_PER_SECOND

_EXAMPLES = """\
examples:
  hil-bench identify run.mf4
  hil-bench identify run.csv bench.toml --axis lift --output lift
  hil-bench identify run.csv bench.toml --require "position 1 mm" --require "time 10 ms"
  hil-bench identify slow.csv fast.csv bench.toml --columns rig.toml
  hil-bench identify a.csv bench.toml --map "t=time:s" --map "s=position:mm" \\
      --map "p1=P_A:bar" --map "U=spool_setpoint:V"
  hil-bench identify today.csv lift/bench.toml --against january.csv
  hil-bench identify --design bench.toml --plan plan.toml
"""

_LONGEST = 86_400.0  # [s]
_ALIKE = 1.5  # rows of two recordings; beyond it, a model misses other parts of a stroke


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "identify",
        description="Fit the plant to whole strokes of a recording, and state how well it\n"
        "predicts strokes that were left out of the fit. Writes bench.toml with the machine,\n"
        "and strokes.png and .svg, record and model stroke by stroke.\n"
        "Exit code 1: a limit of --require is exceeded.",
        epilog=_EXAMPLES,
    )
    parser.add_argument(
        "files",
        nargs="*",
        type=Path,
        metavar="RECORDING",
        help="signals: .csv, .mf4 or .mat; several are fitted together. A bench.toml among them "
        "says what is known of the machine and where the search starts; without it "
        "HIL_BENCH_CONFIG, or else the built-in bench",
    )
    common.add_column_arguments(parser)
    parser.add_argument(
        "--truth",
        action="store_true",
        help="take the plant's own values, which no machine shows, where a bench's recording has "
        "those of its sensors, too",
    )
    parser.add_argument("--axis", metavar="NAME", help="axis to identify (default: the first)")
    for option, help_text in (
        ("--fix", "keys of bench.toml to hold as configured, as in: moving_mass_kg"),
        ("--free", "keys to estimate in every model, as in: external_leakage_a_l_min_bar"),
    ):
        parser.add_argument(
            option, nargs="+", action="extend", default=[], metavar="KEY", help=help_text
        )
    parser.add_argument(
        "--require",
        action="append",
        default=[],
        metavar="LIMIT",
        help="limit on the error of prediction, as in: 'position 1 mm', 'speed 1.5 %%', "
        "'pressure 1 bar', 'time 10 ms'; repeat it for more",
    )
    parser.add_argument(
        "--against",
        type=Path,
        action="append",
        default=[],
        metavar="BEFORE",
        help="earlier recording of the same machine: name what has changed since, in place of a "
        "fit; exit code 1 where something has",
    )
    parser.add_argument(
        "--time-limit",
        type=float,
        default=600.0,
        metavar="S",
        help="end the search after this time with the best so far (default: 600)",
    )
    parser.add_argument(
        "--jobs",
        type=int,
        default=common.count_processors(),
        metavar="N",
        help="runs of the plant at a time (default: %(default)s)",
    )
    common.add_output_argument(parser, "hil-bench-identify", "the files")
    add_design_arguments(parser)
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Identify, write and print; `ExitCode.CHECK_FAILED` where a limit of the user is exceeded.

    Raises:
        ConfigError: a wrong argument, or a recording that cannot serve.
    """
    for package in ("scipy", "matplotlib"):
        require_extra(package, "hil-bench identify")
    check_design_arguments(args)
    limits = _check_arguments(args)
    recordings, bench = _sort_files(args.files, is_design=args.design)
    config = load_config(str(bench) if bench else None)
    axis = common.find_cylinder(config, args.axis, "identification")
    if axis.model is not Model.FULL_ORDER:
        raise ConfigError(f'plant.{axis.name}: identification needs model = "full-order"')
    with common.output_directory(args.output):
        if args.design:
            return run_design(args, Question(config, axis, bench))
        asked = Question(config, axis)
        table = f"plant.{axis.name}"
        settings = {one.key.name: one for one in config.settings if one.table == table}
        wish = _read_wish(args, settings)
        if args.against:
            return _compare(args, asked, settings, wish, recordings)
        with _options_of(args, wish) as options:
            record = _read_records(args, recordings, asked)
            found = identify(record, axis, settings, step=config.dt, options=options)
        return _finish(args, found, asked, recordings, limits)


def _check_arguments(args: argparse.Namespace) -> list[Limit]:
    """Return the limits of the user.

    Raises:
        ConfigError: an option makes no sense.
    """
    most = 4 * common.count_processors()
    if not 1 <= args.jobs <= most:
        raise ConfigError(f"--jobs {args.jobs}: give 1 to {most}")
    if not 1.0 <= args.time_limit <= _LONGEST:
        raise ConfigError(f"--time-limit {args.time_limit:g}: give 1 to {_LONGEST:g}")
    return [read_limit(text) for text in args.require]


def _read_wish(args: argparse.Namespace, settings: Settings) -> Wish:
    """Return the names that the user holds and frees.

    Raises:
        ConfigError: a key is not one of the axis, or is to be both.
    """
    known = [*settings, *ALIASES.values(), DELAY, LAG, DROOP]
    for option, keys in (("--fix", args.fix), ("--free", args.free)):
        for key in keys:
            if key not in known:
                nearest = find_nearest(key, known)
                raise ConfigError(f"{option} {key}: is no unknown; the nearest one is {nearest}")
    if both := set(args.fix) & set(args.free):
        raise ConfigError(f"--fix {min(both)}: --free says the contrary")
    fix = frozenset({*args.fix, *(ALIASES[key] for key in args.fix if key in ALIASES)})
    return Wish(fix, tuple(ALIASES.get(key, key) for key in args.free))


def _compare(
    args: argparse.Namespace,
    asked: Question,
    settings: Settings,
    wish: Wish,
    recordings: Sequence[Path],
) -> int:
    """Name what has changed since an earlier recording; return the exit code.

    Raises:
        ConfigError: the rows of the one recording are much further apart than those of the other.
    """
    with _options_of(args, wish) as options:
        before, record = (_read_records(args, each, asked) for each in (args.against, recordings))
        rows = 1e3 * before.interval, 1e3 * record.interval
        if max(rows) > _ALIKE * min(rows):
            have = "rows each {:g} ms, and the recording each {:g} ms; thin the finer one"
            raise ConfigError(f"--against {args.against[0]}: has {have.format(*rows)}")
        found = compare(before, record, asked.axis, settings, options)
    ending = Ending(args)
    ending.take(verdict_code(fails=bool(found.is_changed), passes=found.is_changed is False))
    print_results(args, describe(found), comparison_to_json(found))
    return ending.code


@contextmanager
def _options_of(args: argparse.Namespace, wish: Wish) -> Iterator[Options]:
    """Show the progress of a search.

    Yields:
        The options of the search.
    """
    with shown_work(args, Work("identify", unit="runs")) as work:

        def tick() -> None:
            work.done += 1

        def say(stage: str) -> None:
            work.stage = stage

        say("reading")
        yield Options(wish, args.jobs, args.time_limit, tick, say)


def _finish(
    args: argparse.Namespace,
    found: Identification,
    asked: Question,
    recordings: Sequence[Path],
    limits: Sequence[Limit],
) -> int:
    """Write and print what was found; return the exit code."""
    ending = Ending(args)
    exceeded = find_exceeded(found.ladder.best.errors, limits)
    ending.take(ExitCode.CHECK_FAILED if exceeded else ExitCode.DONE)
    files: list[Path] = []
    with ending.going_on():
        files += _write(args.output, found, asked, ", ".join(path.name for path in recordings))
    if args.json:
        content = {**to_json(found, limits), "files": [str(path) for path in files]}
        print(json.dumps(content, indent=2))
    elif not args.quiet:
        print("\n".join([summarise(found, limits), "", *(f"wrote {path}" for path in files)]))
    return ending.code


def _write(directory: Path, found: Identification, asked: Question, source: str) -> list[Path]:
    """Write the bench and the figure; return the files."""
    bench = directory / "bench.toml"
    with about_file(bench, right="give a directory of yours"):
        text = write_bench(found, asked.config, source, error_lines(found))
        with whole_file(bench) as file:
            file.write_text(text, encoding="utf-8", errors="backslashreplace")
    return [bench, *write_figure(lambda: draw_strokes(found), directory / "strokes")]


def _sort_files(files: Sequence[Path], *, is_design: bool) -> tuple[list[Path], Path | None]:
    """Return the recordings, and the bench.toml if there is one.

    Raises:
        ConfigError: there is no recording, or more than one bench, or one beside --design.
    """
    benches = [path for path in files if path.suffix.lower() == ".toml"]
    recordings = [path for path in files if path not in benches]
    if is_design and recordings:
        raise ConfigError(
            f"{_names(recordings)}: --design takes a bench.toml; identify first, and give the "
            "bench.toml that this writes"
        )
    if not recordings and not is_design:
        named = f"{_names(files)}: is no recording; " if files else ""
        raise ConfigError(f"{named}give .csv, .mf4 or .mat too")
    if len(benches) > 1:
        raise ConfigError(f"{_names(benches)}: give one bench.toml")
    return recordings, benches[0] if benches else None


def _read_records(args: argparse.Namespace, paths: Sequence[Path], asked: Question) -> AxisRecord:
    """Return all recordings of an axis as one record.

    Raises:
        ConfigError: one of them cannot serve.
    """
    columns = read_column_map(args.columns, args.map) if args.columns or args.map else None
    records = []
    for path in paths:
        try:
            if columns is None:
                records.append(_read_record(path, asked, is_truth=args.truth))
            else:
                records.append(_read_foreign(path, columns, asked))
            check_sides(records[-1], asked.axis.parameters)
        except ConfigError as error:
            text = str(error)
            raise ConfigError(text if text.startswith(str(path)) else f"{path}: {text}") from None
    return join_records(records)


def _read_record(path: Path, asked: Question, *, is_truth: bool) -> AxisRecord:
    """Return one recording of an axis that has our columns: those of its sensors, or the plant's.

    Raises:
        ConfigError: a MAT file has no map.
    """
    if path.suffix.lower() == ".mat":
        raise ConfigError("name its columns in --columns or with --map")
    axis, recording = asked.axis, read_recording(path)
    sensors = {} if is_truth else name_sensors(asked.config, axis)
    recording, note = take_sensors(recording, axis.name, sensors)
    record = settle_signs(_record_of(recording, path, asked), frozenset())
    return replace(record, notes=(*record.notes, note)) if note else record


def _read_foreign(path: Path, columns: ColumnMap, asked: Question) -> AxisRecord:
    """Return one recording of an axis, its columns by a map."""
    mapped = columns.of(path.name)
    recording = read_mapped(path, mapped, asked.axis.name)
    record = replace(_record_of(recording, path, asked), is_sampled=True)
    return settle_signs(record, {name for name, one in mapped.items() if not one.polarity})


def _record_of(recording: Recording, path: Path, asked: Question) -> AxisRecord:
    """Return the record of an axis, after its units and what its logger did are looked through."""
    axis = asked.axis
    names = [name for name in recording.dtype.names or () if name.startswith(f"{axis.name}.")]
    check_quantities(recording, names)
    highest = {f"{axis.name}.position": 2.0 * axis.parameters.h}
    doubts = list(find_doubts(recording, names, highest))
    counted = [f"{axis.name}.{one}" for one in (*NEEDED, *PRESSURES, "spool_position")]
    recording, notes = make_even(recording, [name for name in counted if name in names])
    full_opening = asked.config.full_scale(axis)
    record = AxisRecord.of(recording, axis.name, full_opening, path.name)
    doubts += check_plausible(record, axis.parameters, axis.options)
    warn_of([f"{path}: {doubt}" for doubt in doubts])
    record = look_through(record, axis.parameters.h)
    return replace(record, notes=(*notes, *record.notes))


def name_sensors(config: BenchConfig, axis: CylinderConfig) -> dict[str, str]:
    """Return the name of the first sensor of each quantity of an axis."""
    mine = [node for node in config.nodes if node.axis == axis.name]
    pairs = ((node.kind.measured(node), node.name) for node in reversed(mine))
    return {quantity: name for quantity, name in pairs if quantity is not None}


def _names(paths: Sequence[Path]) -> str:
    return ", ".join(map(str, paths))


# Records that no machine like the configured one gives: wrong units, columns that are swapped.

_WINDOW = 0.02  # [s] over which speeds are taken
_OFTEN = 10  # windows that must be as fast: fewer are disturbances
_TOO_FAST = 3.0  # times the speed without load, all pressure dropping over one edge
_TOO_SLOW = 0.08  # of that speed: no load of a sound machine slows it so much
_TOO_OPEN = 1.2  # of the full opening
_TOO_HIGH = 5.0  # times the supply pressure: unequal areas and loads reach twice that and more
_TOO_LOW, _NOTHING = 0.15, 0.02  # of it


def check_plausible(
    record: AxisRecord, parameters: PlantParameters, options: PlantOptions
) -> list[str]:
    """Return doubts about a record of one recording, in words.

    Args:
        record: of the machine.
        parameters: as configured.
        options: as configured.

    Raises:
        ConfigError: speed or pressures are beyond anything that the configured machine does.
    """
    doubts = _check_speed(record, parameters)
    unit, most = options.supply, float(np.nanmax(record.measured[:, 1:]))
    supply = max(parameters.P_S, unit.relief_pressure if unit else 0.0)
    for place, name in enumerate(PRESSURES, start=1):
        highest = float(record.measured[:, place].max())  # not a number where it is missing
        line = (
            f"{name} is {BAR.from_si(highest):.4g} bar at most, at a supply pressure of "
            f"{BAR.from_si(supply):.4g} bar; check its unit and gain, or supply_pressure_bar"
        )
        if highest > _TOO_HIGH * supply or most < _NOTHING * supply:
            raise ConfigError(line)
        if highest < _TOO_LOW * supply:
            doubts.append(line)
    return doubts


def _check_speed(record: AxisRecord, parameters: PlantParameters) -> list[str]:
    """Return doubts about a position that is slower than the valve of the machine makes it.

    Raises:
        ConfigError: it is faster, or the valve opens further than it can.
    """
    share = float(np.abs(record.setpoints).max()) / record.full_opening
    percent = f"{100.0 * share:.3g} %"
    if share > _TOO_OPEN:
        raise ConfigError(f"spool_setpoint goes to {percent}; check its unit, or full_scale")
    rows = max(1, round(_WINDOW / record.interval))
    position = record.measured[:, 0]
    speeds = np.abs(position[rows:] - position[:-rows]) / (rows * record.interval)
    speed = float(np.quantile(speeds, 1.0 - min(0.05, _OFTEN * rows / len(speeds))))
    opening = min(share * parameters.full_opening, parameters.alpha)
    flow = parameters.K * opening * math.sqrt(parameters.P_S - parameters.P_T)
    fastest = flow / min(parameters.A_A, parameters.A_B)
    shown, most = (MILLIMETRE_PER_SECOND.from_si(each) for each in (speed, fastest))
    line = (
        f"the position changes by {shown:.4g} mm/s, and at set-points of up to {percent} the "
        f"configured valve gives {most:.4g} mm/s without any load; check that the columns of "
        "position and spool_setpoint are those, and their units, gains and full_scale"
    )
    if speed > _TOO_FAST * fastest:
        raise ConfigError(line)
    return [line] if speed < _TOO_SLOW * fastest else []
