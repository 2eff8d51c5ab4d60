"""`hil-bench analyse`: the analyses of valve and cylinder, as text, JSON, tables and figures."""

import argparse
import json
from pathlib import Path

from hil_bench.abilities.analysis.paper import check_paper, write_paper
from hil_bench.abilities.analysis.paper_runs import run_paper
from hil_bench.abilities.analysis.study import Study, write_study
from hil_bench.abilities.analysis.verbs.analyses import Names, add_analyses, add_analysis
from hil_bench.bench.configuration import load_config
from hil_bench.cli.arguments import add_output_argument, find_cylinder, make_directory
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import print_lines
from hil_bench.cli.status_line import Work, shown_work
from hil_bench.extras import require_extra

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
        print(json.dumps({"statements": found, "files": files}, indent=2, ensure_ascii=False))
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
    return json.dumps(content, indent=2, ensure_ascii=False)
