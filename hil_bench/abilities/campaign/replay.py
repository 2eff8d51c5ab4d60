"""A run of a campaign played again, for the picture of what went wrong in it."""

from typing import NamedTuple

from hil_bench.abilities.campaign.records import RunResult, RunSpec
from hil_bench.abilities.campaign.running import play_spec, verdicts_of
from hil_bench.abilities.campaign.summary import size_of
from hil_bench.abilities.scenario.report import make_exhibit
from hil_bench.abilities.scenario.run import PlayOptions
from hil_bench.errors import HilBenchError


class Replay(NamedTuple):
    """The result of a replayed run.

    Attributes:
        picture: of the requirement with the smallest margin, an SVG file; empty for none.
        problem: why there is none.
    """

    picture: bytes
    problem: str = ""


def replay(spec: RunSpec, result: RunResult) -> Replay:
    """Play a run again, and draw the requirement with the smallest margin.

    Args:
        spec: the run.
        result: what came of it in the campaign.
    """
    if result.outcome.is_cut_off:
        return Replay(b"", "it did not come to its end, so it is not drawn")
    try:
        run = play_spec(spec, PlayOptions(keeps_evidence=True))
    except HilBenchError as error:
        return Replay(b"", f"played again it fails otherwise: {error}")
    if verdicts_of(run) != result.verdicts or run.evidence is None:
        return Replay(b"", "played again it has other margins: the controller is not deterministic")
    sizes = [size_of(each) for each in result.verdicts]
    return Replay(make_exhibit(run.findings[sizes.index(min(sizes))], run.evidence).picture)
