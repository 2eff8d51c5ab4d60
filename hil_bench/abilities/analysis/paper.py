"""The paper's figures 2 to 6, and its statements beside the numbers found, as one report."""

from collections.abc import Sequence
from pathlib import Path

from hil_bench.abilities.analysis.linear_statements import linear_statements
from hil_bench.abilities.analysis.linear_studies import (
    flow_pressure_study,
    operating_points_study,
    root_locus_study,
)
from hil_bench.abilities.analysis.model_statements import (
    PaperRuns,
    Statement,
    Verdict,
    model_statements,
    run_paper,
)
from hil_bench.abilities.analysis.simulated_studies import (
    measured_responses_study,
    trajectories_study,
)
from hil_bench.abilities.analysis.simulation_statements import simulation_statements
from hil_bench.abilities.analysis.study import Study, write_study
from hil_bench.errors import about_file, check_replaceable, whole_file

REPORT = "paper-report.md"
"""Name of the report's file."""

IMAGES = "images"
"""Name of the directory of figures and data beside it."""

_CAPTIONS = {
    "paper-fig2": "Root locus for the open loop k G(s) / s.",
    "paper-fig3": "Static load flow-pressure characteristic curves.",
    "paper-fig4": "Responses of the linearised system (24) at four operating points.",
    "paper-fig5": "Measured responses of both models; input nonlinearities left out.",
    "paper-fig6": "Velocity trajectories and phase portraits for sinusoidal inputs.",
}

_HEAD = """\
# The paper, checked

M. Ruderman, "Full- and Reduced-order Model of Hydraulic Cylinder for Motion Control", IECON 2017,
with the parameters of its Table I. `hil-bench analyse paper --output DIR` writes this report, the
figures (PNG, SVG) and their data (CSV).

Sections IV-B and IV-C are simulated as the paper says: forward Euler at 1e-4 s, tanh(400 v) for the
sign. What it does not say was decided: a run starts from rest at mid-stroke with P_A A_A = P_B A_B;
the chirp is linear in time and lasts {duration:g} s; spectra are by Welch's method (Hann windows of
4 s, three quarters of each in common), smoothed over 1/48 of an octave; they are corrected for the
set-point's hold over a step. Nothing was tuned to the paper's pictures.
"""


def check_paper(runs: PaperRuns) -> list[Statement]:
    """Return every statement that was checked, in the order of the paper."""
    return [
        *model_statements(runs),
        *linear_statements(runs.parameters),
        *simulation_statements(runs),
    ]


def paper_studies(runs: PaperRuns) -> list[Study]:
    """Return the studies that draw figures 2 to 6."""
    return [
        root_locus_study(runs.parameters, name="paper-fig2"),
        flow_pressure_study(runs.parameters, name="paper-fig3"),
        operating_points_study(runs.parameters, name="paper-fig4"),
        measured_responses_study(runs.chirps, name="paper-fig5"),
        trajectories_study(runs.trajectories, name="paper-fig6"),
    ]


def write_paper(directory: Path, runs: PaperRuns | None = None) -> list[Path]:
    """Write figures, data and report; return the files, the report first.

    Args:
        directory: that is there.
        runs: what was simulated; None to simulate it now.
    """
    report = directory / REPORT
    images = directory / IMAGES
    with about_file(directory, right="give a directory of yours"):
        images.mkdir(exist_ok=True)
        check_replaceable(report)
        report.touch()
    runs = run_paper() if runs is None else runs
    files = [path for study in paper_studies(runs) for path in write_study(study, images)]
    with about_file(report), whole_file(report) as file:
        file.write_text(report_text(runs), encoding="utf-8")
    return [report, *files]


def report_text(runs: PaperRuns) -> str:
    """Return the report as Markdown."""
    statements = check_paper(runs)
    parts = [_HEAD.format(duration=runs.chirps[0].chirp.duration), _counts(statements)]
    parts += ["## Statements\n", _table(statements), "## Figures\n"]
    parts += [
        f"![{caption}]({IMAGES}/{name}.png)\n\nFig. {name[-1]}. {caption}\n"
        for name, caption in _CAPTIONS.items()
    ]
    return "\n".join(parts)


def _counts(statements: Sequence[Statement]) -> str:
    verdicts = [statement.verdict for statement in statements]
    counts = [f"{verdict}: {verdicts.count(verdict)}" for verdict in Verdict]
    return f"{len(statements)} statements. {'; '.join(counts)}.\n"


def _table(statements: Sequence[Statement]) -> str:
    rows = ["| where | the paper | found | verdict |", "|---|---|---|---|"]
    for place, claim, found, verdict in statements:
        cells = (place, claim, found, f"**{verdict}**")
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(rows) + "\n"
