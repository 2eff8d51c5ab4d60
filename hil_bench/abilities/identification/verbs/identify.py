"""`hil-bench identify`: the plant's parameters from a recording."""

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from hil_bench.abilities.identification.choice import (
    Choice,
    choose,
    find_sensors,
    with_filters,
    with_hysteresis,
)
from hil_bench.abilities.identification.columns import (
    ColumnMap,
    check_units,
    map_columns,
    read_column_map,
    take_sensors,
)
from hil_bench.abilities.identification.design.knowledge import Knowledge, read_knowledge
from hil_bench.abilities.identification.design.report import design_to_json, summarise_design
from hil_bench.abilities.identification.identify import (
    Identification,
    check_options,
    identify,
)
from hil_bench.abilities.identification.logger import look_through
from hil_bench.abilities.identification.plot import draw_trial
from hil_bench.abilities.identification.record import AxisRecord, join_records
from hil_bench.abilities.identification.report import is_explained, summarise, to_json, to_toml
from hil_bench.abilities.identification.signs import settle_signs
from hil_bench.abilities.identification.stops import find_stops
from hil_bench.abilities.identification.unknowns import Sensors
from hil_bench.abilities.identification.verbs.identify_design import (
    Question,
    add_design_arguments,
    check_design_arguments,
    find_design,
    write_design,
)
from hil_bench.bench.configuration import BenchConfig, load_config
from hil_bench.cli.arguments import add_output_argument, find_cylinder, output_directory
from hil_bench.cli.doubts import warn_of
from hil_bench.cli.exit_codes import Ending, ExitCode
from hil_bench.cli.progress import Work, shown_work
from hil_bench.cli.results import add_json_argument
from hil_bench.devices.measurement.parameters import ChainParameters
from hil_bench.errors import ConfigError, about_file, whole_file
from hil_bench.extras import require_extra
from hil_bench.figure_style import write_figure
from hil_bench.kinds.motion_sensor import MotionConfig
from hil_bench.kinds.pressure_404 import PressureConfig
from hil_bench.outside.recording.channels import Recording
from hil_bench.outside.recording.column_units import check_quantities, find_doubts
from hil_bench.outside.recording.files import read_recording
from hil_bench.outside.recording.foreign_table import read_columns, read_units
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_bench.plants.hydraulic_cylinder.model import Model

_EXAMPLES = """\
examples:
  hil-bench identify run.mf4
  hil-bench identify run.csv bench.toml --axis lift --output lift
  hil-bench identify slow.csv fast.csv bench.toml --columns rig.toml
  hil-bench identify a.csv bench.toml --map "t=time:s" --map "s=position:mm" \\
      --map "p1=P_A:bar" --map "U=spool_setpoint:V"
  hil-bench identify --design bench.toml --plan plan.toml
  hil-bench identify --design run.mf4 bench.toml
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "identify",
        description="Estimate the plant's parameters with 95 % intervals from a recording, and\n"
        "name those that it cannot identify. Writes parameters.toml, a table for bench.toml, and\n"
        "trial.png and .svg, the model beside the part of the record that was not fitted.\n"
        "Exit code 1: the model does not explain the record.",
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
    parser.add_argument(
        "--columns",
        type=Path,
        metavar="FILE.toml",
        help="file that gives the quantity of each column, for tables of other tools",
    )
    parser.add_argument(
        "--map",
        action="append",
        default=[],
        metavar="COLUMN=QUANTITY:UNIT",
        help="the same for one column; -QUANTITY changes the sign; repeat it for more",
    )
    parser.add_argument(
        "--truth",
        action="store_true",
        help="take the plant's own values, which no machine shows, where a bench's recording has "
        "those of its sensors, too",
    )
    parser.add_argument("--axis", metavar="NAME", help="axis to identify (default: the first)")
    for option, help_text in (
        ("--fix", "keys of bench.toml to hold as configured, as in: moving_mass_kg"),
        ("--free", "keys to estimate beside the usual ones, as in: supply_pressure_bar"),
    ):
        parser.add_argument(
            option, nargs="+", action="extend", default=[], metavar="KEY", help=help_text
        )
    add_output_argument(parser, "hil-bench-identify", "the files")
    parser.add_argument(
        "--starts",
        type=int,
        default=24,
        metavar="N",
        help="number of starts of the search (default: 24)",
    )
    add_design_arguments(parser)
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Identify, write and print; `ExitCode.CHECK_FAILED` where the model misses a signal.

    Raises:
        ConfigError: a wrong argument, or a recording that is none or tells nothing.
    """
    for package in ("scipy", "matplotlib"):
        require_extra(package, "hil-bench identify")
    if not 1 <= args.starts <= 10_000:
        raise ConfigError(f"--starts {args.starts}: give 1 to 10000")
    check_design_arguments(args)
    files = _sort_files(args.files, is_design=args.design)
    config = load_config(str(files.bench) if files.bench else None)
    axis = find_cylinder(config, args.axis, "identification")
    if axis.model is not Model.FULL_ORDER:
        raise ConfigError(f'plant.{axis.name}: identification needs model = "full-order"')
    check_options(axis.options)
    chains = _find_chains(config, axis)
    sensors = find_sensors(*chains)
    choice = _choose(args, config, axis, sensors)
    asked = Question(config, files.bench, axis, choice.names, sensors, chains, None)
    with output_directory(args.output):
        return _answer(args, asked, files)


def _answer(args: argparse.Namespace, asked: Question, files: "Files") -> int:
    """Identify what there are recordings of, write and print."""
    found: Identification | None = None
    is_right = True
    if files.recordings:
        found, asked = _fit(args, asked, files.recordings)
        asked = asked._replace(knowledge=Knowledge.of(found))
        is_right = is_explained(found)
    elif files.result is not None:
        asked = asked._replace(knowledge=read_knowledge(files.result))
    ending = Ending(args)
    ending.take(ExitCode.DONE if is_right else ExitCode.CHECK_FAILED)
    _finish(args, found, asked, files.recordings, ending)
    return ending.code


class Files(NamedTuple):
    """The files that the command line names.

    Attributes:
        recordings: of the machine.
        bench: what is known of it; None for the built-in bench.
        result: of an identification, as JSON; None for none.
    """

    recordings: list[Path]
    bench: Path | None
    result: Path | None


def _choose(
    args: argparse.Namespace, config: BenchConfig, axis: CylinderConfig, sensors: Sensors
) -> Choice:
    settings = [one for one in config.settings if one.table == f"plant.{axis.name}"]
    return choose(settings, sensors, args.fix, args.free)


def _fit(
    args: argparse.Namespace, asked: Question, recordings: Sequence[Path]
) -> tuple[Identification, Question]:
    """Estimate parameters from recordings; return the question as they have changed it, too.

    Raises:
        ConfigError: they cannot serve, or tell nothing.
    """
    record = _read_records(args, recordings, asked)
    sensors = with_filters(asked.sensors, record.filters, args.fix)
    choice = _choose(args, asked.config, asked.axis, sensors)
    names = choice.names
    if asked.axis.options.end_stop is not None:
        record = find_stops(record, asked.axis.parameters.h)
        if record.at_stop is not None and not {"stroke_mm"} & {*args.fix, *args.free}:
            names = (*names, "h")
    asked = asked._replace(names=names, sensors=sensors)
    record = with_hysteresis(record, *asked.chains)
    held = (f"held: {key}, {reason}" for key, reason in choice.held.items())
    record = replace(record, notes=(*record.notes, *held))
    try:
        return _identify(args, asked, record), asked
    except ConfigError as error:
        raise ConfigError(f"{_names(recordings)}: {error}") from None


def _finish(
    args: argparse.Namespace,
    found: Identification | None,
    asked: Question,
    recordings: Sequence[Path],
    ending: Ending,
) -> None:
    """Write and print what was found, and the design where one is wanted and the model is right."""
    texts: list[str] = []
    content: dict[str, Any] = {}
    files: list[Path] = []
    if found is not None:
        with ending.going_on():
            files += _write(args.output, found, ", ".join(path.name for path in recordings))
        texts += [summarise(found), ""]
        content |= to_json(found)
    if args.design and ending.code is not ExitCode.CHECK_FAILED:
        design, notes = find_design(args, asked)
        with ending.going_on():
            files += write_design(args.output, design, asked, args.plan)
        texts += [summarise_design(design, notes), ""]
        content["design"] = design_to_json(design)
    elif args.design:
        texts += ["no manoeuvre was designed, since the model does not explain the record", ""]
    if args.json:
        print(json.dumps({**content, "files": [str(path) for path in files]}, indent=2))
    elif not args.quiet:
        print("\n".join([*texts, *(f"wrote {path}" for path in files)]))


def _sort_files(files: Sequence[Path], *, is_design: bool) -> Files:
    """Return the files by what they are.

    Raises:
        ConfigError: there is no recording, or more than one bench, or a result beside a recording.
    """
    benches = [path for path in files if path.suffix.lower() == ".toml"]
    results = [path for path in files if path.suffix.lower() == ".json"]
    recordings = [path for path in files if path not in {*benches, *results}]
    if not recordings and not is_design:
        named = f"{_names(files)}: is no recording; " if files else ""
        raise ConfigError(f"{named}give .csv, .mf4 or .mat too")
    if len(benches) > 1:
        raise ConfigError(f"{_names(benches)}: give one bench.toml")
    if results and (len(results) > 1 or recordings or not is_design):
        raise ConfigError(f"{_names(results)}: give one result, with --design, and no recording")
    return Files(recordings, benches[0] if benches else None, results[0] if results else None)


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
        except ConfigError as error:
            raise ConfigError(_about(path, error)) from None
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
    record = _record_of(recording, path, asked)
    return replace(record, notes=(*record.notes, note)) if note else record


def _read_foreign(path: Path, columns: ColumnMap, asked: Question) -> AxisRecord:
    """Return one recording of an axis, its columns by a map.

    Raises:
        ConfigError: the map and the file contradict each other.
    """
    mapped = columns.of(path.name)
    table = read_columns(path)
    try:
        check_units(read_units(path), mapped)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    recording = map_columns(table, mapped, asked.axis.name)
    record = _record_of(recording, path, asked)
    return settle_signs(record, {name for name, one in mapped.items() if not one.polarity})


def _record_of(recording: Recording, path: Path, asked: Question) -> AxisRecord:
    """Return the record of an axis, after its units and what its logger did are looked through."""
    axis = asked.axis
    names = [name for name in recording.dtype.names or () if name.startswith(f"{axis.name}.")]
    check_quantities(recording, names)
    doubts = find_doubts(recording, names, {f"{axis.name}.position": 2.0 * axis.parameters.h})
    warn_of([f"{path}: {doubt}" for doubt in doubts])
    full_opening = asked.config.full_scale(axis)
    return look_through(AxisRecord.of(recording, axis.name, full_opening, path.name))


def name_sensors(config: BenchConfig, axis: CylinderConfig) -> dict[str, str]:
    """Return the name of the first sensor of each quantity of an axis."""
    mine = [node for node in config.nodes if node.axis == axis.name]
    pairs = ((node.kind.measured(node), node.name) for node in reversed(mine))
    return {quantity: name for quantity, name in pairs if quantity is not None}


def _find_chains(
    config: BenchConfig, axis: CylinderConfig
) -> tuple[ChainParameters | None, ChainParameters | None]:
    """Return the chains of an axis's sensors of position and pressure, as far as it has them."""
    mine = [node for node in config.nodes if node.axis == axis.name]
    position = (node.chain for node in mine if isinstance(node, MotionConfig))
    pressure = (node.chain for node in mine if isinstance(node, PressureConfig))
    return next(position, None), next(pressure, None)


def _about(path: Path, error: ConfigError) -> str:
    text = str(error)
    return text if text.startswith(str(path)) else f"{path}: {text}"


def _names(paths: Sequence[Path]) -> str:
    return ", ".join(map(str, paths))


def _identify(args: argparse.Namespace, asked: Question, record: AxisRecord) -> Identification:
    # How long a fit takes shows only when it has converged, so its steps have no total.
    with shown_work(args, Work("identify", unit="steps")) as work:
        return identify(
            record,
            asked.axis.parameters,
            asked.axis.options,
            step=asked.config.dt,
            names=asked.names,
            sensors=asked.sensors,
            starts=args.starts,
            seed=asked.config.seed,
            report=work.begin,
        )


def _write(directory: Path, found: Identification, source: str) -> list[Path]:
    """Write the parameters and the figure; return the files."""
    parameters = directory / "parameters.toml"
    with about_file(parameters, right="give a directory of yours"):
        text = to_toml(found, source)
        with whole_file(parameters) as file:
            file.write_text(text, encoding="utf-8", errors="backslashreplace")
    return [parameters, *write_figure(lambda: draw_trial(found), directory / "trial")]
