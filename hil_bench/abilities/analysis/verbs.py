"""The `hil-bench analyse` command: the statements of the paper, and its figures."""

import argparse
from collections.abc import Callable
from pathlib import Path

from hil_bench.abilities.analysis.frequency_response import SMOOTHING, Chirp
from hil_bench.abilities.analysis.model_statements import run_paper
from hil_bench.abilities.analysis.operating_point import find_operating_point
from hil_bench.abilities.analysis.paper import check_paper, write_paper
from hil_bench.abilities.analysis.simulation import Setup
from hil_bench.abilities.analysis.study import (
    Study,
    flow_pressure_study,
    linearisation_study,
    measure_both_models,
    measured_responses_study,
    operating_points_study,
    root_locus_study,
    simulate_both_models,
    trajectories_study,
    write_study,
)
from hil_bench.abilities.common.arguments import add_output_argument, find_cylinder
from hil_bench.abilities.common.files import make_directory
from hil_bench.abilities.common.progress import Work, shown_work
from hil_bench.bench.configuration import BenchConfig, load_config
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import add_json_argument, json_text, print_lines
from hil_bench.errors import require_extra
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_bench.plants.hydraulic_cylinder.model import balanced_state

# The analyses that `hil-bench analyse` knows: what each takes, and how it is done.

Names = argparse._SubParsersAction  # noqa: SLF001 - argparse has no public name for it
"""Where the parsers of the analyses are added."""


def add_analyses(names: "Names[argparse.ArgumentParser]") -> None:
    """Add the parsers of all analyses but the paper's."""
    for add in (
        _add_linearisation,
        _add_root_locus,
        _add_flow_pressure,
        _add_frequency_response,
        _add_trajectories,
    ):
        add(names)


def add_analysis(
    names: "Names[argparse.ArgumentParser]",
    name: str,
    summary: str,
    study: Callable[[argparse.Namespace, BenchConfig, CylinderConfig], Study] | None,
    examples: str,
) -> argparse.ArgumentParser:
    """Add the parser of one analysis and return it, for its own arguments.

    Args:
        names: where parsers of analyses are added.
        name: of the analysis.
        summary: in a line.
        study: does it; None for the paper's, which takes no bench.
        examples: of its use, a line each.
    """
    parser = names.add_parser(
        name,
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}.",
        epilog=f"examples:\n{examples}",
    )
    if study is not None:
        parser.add_argument(
            "config",
            nargs="?",
            metavar="bench.toml",
            help="the bench (default: HIL_BENCH_CONFIG, else the built-in bench: Table I)",
        )
        parser.add_argument("--axis", metavar="NAME", help="the axis; the first one by default")
        parser.add_argument(
            "-o",
            "--output",
            type=Path,
            metavar="DIR",
            help="folder for tables and figures (default: write none)",
        )
    add_json_argument(parser)
    parser.set_defaults(study=study)
    return parser


def _add_linearisation(names: "Names[argparse.ArgumentParser]") -> None:
    parser = add_analysis(
        names,
        "linearisation",
        "both models about one operating point: eqs. (18)-(24), Jacobian, poles, zeros",
        _linearisation,
        "  hil-bench analyse linearisation --velocity-mm-s 100\n"
        "  hil-bench analyse linearisation bench.toml --spool-position-mm -0.8 --load-n 5000\n",
    )
    point = parser.add_mutually_exclusive_group()
    point.add_argument(
        "--velocity-mm-s",
        type=float,
        metavar="V",
        help="velocity of the piston in mm/s (default: 100)",
    )
    point.add_argument("--spool-position-mm", type=float, metavar="NU", help="spool position")
    parser.add_argument(
        "--position-mm",
        type=float,
        default=0.0,
        metavar="X",
        help="position from mid-stroke in mm (default: 0)",
    )
    parser.add_argument("--load-n", type=float, default=0.0, metavar="F", help="load (0 N)")


def _linearisation(args: argparse.Namespace, _config: BenchConfig, axis: CylinderConfig) -> Study:
    spool, velocity = args.spool_position_mm, args.velocity_mm_s
    if spool is None and velocity is None:
        velocity = 100.0
    point = find_operating_point(
        axis.parameters,
        axis.options,
        position=args.position_mm * 1e-3,
        velocity=None if velocity is None else velocity * 1e-3,
        spool_position=None if spool is None else spool * 1e-3,
        load=args.load_n,
    )
    return linearisation_study(axis.parameters, point, axis.options)


def _add_root_locus(names: "Names[argparse.ArgumentParser]") -> None:
    add_analysis(
        names,
        "root-locus",
        "poles of position control over its gain, k G(s) / s, and the critical gain",
        lambda _args, _config, axis: root_locus_study(axis.parameters),
        "  hil-bench analyse root-locus\n"
        "  hil-bench analyse root-locus bench.toml --output results\n",
    )


def _add_flow_pressure(names: "Names[argparse.ArgumentParser]") -> None:
    add_analysis(
        names,
        "flow-pressure",
        "static load flow over load pressure, a curve an orifice state, eq. (14)",
        lambda _args, _config, axis: flow_pressure_study(axis.parameters),
        "  hil-bench analyse flow-pressure bench.toml --output results\n",
    )


def _add_frequency_response(names: "Names[argparse.ArgumentParser]") -> None:
    parser = add_analysis(
        names,
        "frequency-response",
        "set-point to velocity: eq. (24), and measured with a chirp on both models",
        _frequency_response,
        "  hil-bench analyse frequency-response\n"
        "  hil-bench analyse frequency-response bench.toml --amplitude-mm 0.5 --with-valve\n"
        "  hil-bench analyse frequency-response --from-hz 300 --to-hz 2 --duration 120\n",
    )
    parser.add_argument(
        "--amplitude-mm",
        type=float,
        nargs="+",
        metavar="U",
        help="amplitudes of the spool set-point (full opening of the orifice, and 30 %% of it)",
    )
    parser.add_argument("--from-hz", type=float, default=600.0, metavar="F", help="(600 Hz)")
    parser.add_argument("--to-hz", type=float, default=1.0, metavar="F", help="(1 Hz)")
    parser.add_argument(
        "--duration",
        type=float,
        default=60.0,
        metavar="S",
        help="length of the chirp in s (default: 60)",
    )
    parser.add_argument(
        "--smoothing",
        type=float,
        default=SMOOTHING,
        metavar="W",
        help="width of the moving average over the spectra, in octaves (1/48); 0 for none",
    )
    parser.add_argument(
        "--with-valve", action="store_true", help="keep dead-zone and saturation, eq. (2)"
    )


def _frequency_response(
    args: argparse.Namespace, config: BenchConfig, axis: CylinderConfig
) -> Study:
    alpha = axis.parameters.alpha
    amplitudes = (
        [alpha, 0.3 * alpha]
        if args.amplitude_mm is None
        else [amplitude * 1e-3 for amplitude in args.amplitude_mm]
    )
    chirps = [
        Chirp(
            amplitude=amplitude,
            start_frequency=args.from_hz,
            end_frequency=args.to_hz,
            duration=args.duration,
        )
        for amplitude in amplitudes
    ]
    linear = operating_points_study(axis.parameters)
    measured = measured_responses_study(
        measure_both_models(
            _setup(config, axis), chirps, with_valve=args.with_valve, smoothing=args.smoothing
        )
    )
    return Study(
        title="Frequency responses",
        facts=[*linear.facts, *measured.facts],
        tables={**linear.tables, **measured.tables},
        figures={**linear.figures, **measured.figures},
    )


def _add_trajectories(names: "Names[argparse.ArgumentParser]") -> None:
    parser = add_analysis(
        names,
        "trajectories",
        "velocity and load pressure of both models under a sinusoidal set-point",
        _trajectories,
        "  hil-bench analyse trajectories\n"
        "  hil-bench analyse trajectories bench.toml --amplitude-mm 1.2 --frequency-hz 0.5\n",
    )
    parser.add_argument(
        "--amplitude-mm",
        type=float,
        nargs="+",
        metavar="U",
        help="amplitudes of the spool set-point (dead-zone and 10 %% of the opening; the opening)",
    )
    parser.add_argument(
        "--frequency-hz",
        type=float,
        default=0.1,
        metavar="F",
        help="frequency of the sine in Hz (default: 0.1)",
    )
    parser.add_argument(
        "--duration",
        type=float,
        default=10.0,
        metavar="S",
        help="length of the run in s (default: 10)",
    )


def _trajectories(args: argparse.Namespace, config: BenchConfig, axis: CylinderConfig) -> Study:
    parameters = axis.parameters
    amplitudes = (
        [parameters.beta + 0.1 * parameters.alpha, parameters.alpha]
        if args.amplitude_mm is None
        else [amplitude * 1e-3 for amplitude in args.amplitude_mm]
    )
    pairs = simulate_both_models(
        _setup(config, axis), amplitudes, frequency=args.frequency_hz, duration=args.duration
    )
    return trajectories_study(pairs)


def _setup(config: BenchConfig, axis: CylinderConfig) -> Setup:
    return Setup(
        parameters=axis.parameters,
        options=axis.options,
        solver=axis.solver,
        dt=config.dt,
        state=balanced_state(axis.parameters, x=axis.position),
        delay=axis.spool_delay,
    )


# `hil-bench analyse`: the analyses of valve and cylinder, as text, JSON, tables and figures.

_EXAMPLES = """\
examples:
  hil-bench analyse linearisation --velocity-mm-s 100
  hil-bench analyse root-locus bench.toml --output results
  hil-bench analyse frequency-response bench.toml --amplitude-mm 1 0.3
  hil-bench analyse paper --output paper
  hil-bench analyse trajectories --help
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb, and under it a parser an analysis."""
    parser = subparsers.add_parser(
        "analyse",
        description="Analyse valve and cylinder, of the paper or of your bench. Figures go to\n"
        "standard output; with --output, tables (CSV) and figures (PNG, SVG) go to files.",
        epilog=_EXAMPLES,
    )
    names = parser.add_subparsers(title="analyses", metavar="NAME", required=True)
    add_analyses(names)
    _add_paper(names)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Do the analysis that was asked for."""
    for package in ("scipy", "matplotlib"):
        require_extra(package, "hil-bench analyse")
    if args.output is not None:
        make_directory(args.output)
    if args.study is None:
        return _run_paper(args)
    config = load_config(args.config)
    with shown_work(args, Work("analyse")):
        study: Study = args.study(args, config, find_cylinder(config, args.axis, "an analysis"))
        files = [] if args.output is None else write_study(study, args.output)
    if args.json:
        print(_json(study, files))
    else:
        print_lines(args, _text(study, files))
    return ExitCode.DONE


def _add_paper(names: "Names[argparse.ArgumentParser]") -> None:
    parser = add_analysis(
        names,
        "paper",
        "figures 2 to 6 of the paper, and its statements beside the numbers found (Table I)",
        None,
        "  hil-bench analyse paper --output paper\n",
    )
    add_output_argument(parser, "hil-bench-paper", "report, figures and data")


def _run_paper(args: argparse.Namespace) -> int:
    with shown_work(args, Work("analyse paper")) as work:
        work.begin("simulating some ten minutes of both models")
        runs = run_paper()
        work.begin("writing report and figures")
        files = [str(path) for path in write_paper(args.output, runs)]
    statements = check_paper(runs)
    if args.json:
        found = [statement._asdict() for statement in statements]
        print(json_text({"statements": found, "files": files}))
    else:
        for statement in statements:
            print_lines(args, f"{statement.verdict:25} {statement.place:16} {statement.claim}")
        print_lines(args, f"\nreport    {files[0]}")
    return ExitCode.DONE


def _text(study: Study, files: list[Path]) -> str:
    width = max(len(fact.name) for fact in study.facts)
    lines = [f"{fact.name:{width}}  {fact.text} {fact.unit}" for fact in study.facts]
    return "\n".join([study.title, "", *lines, *(f"wrote {path}" for path in files)])


def _json(study: Study, files: list[Path]) -> str:
    facts = [{"name": fact.name, "value": fact.plain, "unit": fact.unit} for fact in study.facts]
    content = {"title": study.title, "facts": facts, "files": [str(path) for path in files]}
    return json_text(content)
