"""A scenario that takes milliseconds, and whose margins have a closed form."""

from pathlib import Path

from hil_bench.abilities.campaign.records import RunOutcome, RunResult, Verdict
from hil_bench.plants.hydraulic_cylinder.model import paper_parameters

REST = """\
title = "Rest"
duration_s = 0.01
[parameters]
limit_bar = { value = 250.0, range = [1.0, 301.0] }
load_n = { value = 0.0, range = [-1.0, 1.0] }
[[step]]
at_s = 0.01
set = { "axis1.load" = "load_n" }
[[expect]]
id = "R-1"
that = "always axis1.P_A < limit_bar"
[[expect]]
id = "R-2"
that = "always axis1.P_B < 200 bar"
"""


def write_rest(folder: Path, text: str = REST) -> Path:
    """Return the path of the scenario."""
    path = folder / "rest.scenario.toml"
    path.write_text(text)
    return path


def run_result(
    *verdicts: Verdict, outcome: str = "", key: str = "k", **others: object
) -> RunResult:
    """Return a result of the scenario "s", whose outcome is that of its first verdict."""
    found = RunOutcome(outcome or verdicts[0].outcome)
    run = RunResult(key, "s", "", "", None, {}, found, verdicts=verdicts)
    return run._replace(**others)


def rest_pressures() -> tuple[float, float]:
    """Return P_A and P_B at rest [bar], where they hold the piston.

    The mean is that of supply and tank, and P_A A_A = P_B A_B (Ruderman 2017, eq. (12)).
    """
    parameters = paper_parameters()
    total = (parameters.P_S + parameters.P_T) / 1e5
    share = parameters.A_B / (parameters.A_A + parameters.A_B)
    return total * share, total * (1.0 - share)


def margin_of(limit_bar: float) -> float:
    """Return the margin of R-1: the distance from the limit, as a share of it."""
    return 1.0 - rest_pressures()[0] / limit_bar
