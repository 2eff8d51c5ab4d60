"""A commissioning as those see it who watch, and its steps and results in words."""

from collections import Counter

from hil_bench.abilities.commissioning.measures import StepResult
from hil_bench.abilities.commissioning.plan import CommissioningPlan, Limits, Step
from hil_bench.abilities.commissioning.report import verdict_of
from hil_bench.abilities.commissioning.session import Commissioning
from hil_bench.cli.feed_side import WorkView
from hil_bench.plants.hydraulic_cylinder.quantities import P_A, P_B
from hil_bench.session.work_feed import WorkItem
from hil_bench.shown_units import shown_unit


class ShownPlan:
    """A plan as those see it who watch.

    Args:
        plan: the steps.
        axis: the name of the axis.
        view: where it is shown.

    Attributes:
        view: as passed in.
    """

    def __init__(self, plan: CommissioningPlan, axis: str, view: WorkView) -> None:
        self.view = view
        self._axis = axis
        self._steps = plan.steps
        self._results: list[StepResult] = []
        view.show(total=len(plan.steps), items=self._items())

    def begin(self, step: Step) -> None:
        """Show the step that begins, with its limits."""
        self.view.show(
            now=str(step.kind),
            detail=limits_text(step.limits),
            limits=limits_by_channel(self._axis, step.limits),
            items=self._items(is_running=True),
        )

    def end(self, result: StepResult) -> None:
        """Show what came of a step."""
        self._results.append(result)
        self.view.show(
            now="",
            detail="",
            limits={},
            done=len(self._results),
            counts=Counter(str(each.verdict) for each in self._results),
            items=self._items(),
        )

    def finish(self, found: Commissioning) -> None:
        """Show what came of all."""
        self.view.show(verdict=verdict_of(found))

    def _items(self, *, is_running: bool = False) -> list[WorkItem]:
        done = [
            WorkItem(
                str(each.kind),
                str(each.verdict),
                "; ".join(filter(None, [result_text(each), *(f.name for f in each.findings)])),
            )
            for each in self._results
        ]
        left = [
            WorkItem(str(step.kind), "", limits_text(step.limits))
            for step in self._steps[len(done) :]
        ]
        if is_running:
            left[0] = left[0]._replace(verdict="runs")
        return done + left


def limits_by_channel(axis: str, limits: Limits) -> dict[str, tuple[float, float]]:
    """Return lowest and highest value, in SI, of each channel of an axis that has limits."""
    return {
        f"{axis}.position": limits.position,
        f"{axis}.speed": (-limits.speed, limits.speed),
        f"{axis}.{P_A}": limits.pressure,
        f"{axis}.{P_B}": limits.pressure,
    }


def limits_text(limits: Limits) -> str:
    """Return limits in words."""
    length, speed, pressure = (shown_unit(symbol) for symbol in ("m", "m/s", "Pa"))
    parts = [
        f"position {length.range_text(*limits.position)}",
        f"speed to {speed.short(limits.speed)}",
        f"pressure {pressure.range_text(*limits.pressure)}",
        f"time to {limits.time:g} s",
    ]
    if limits.contact_speed is not None:
        parts.append(f"contact to {speed.short(limits.contact_speed)}")
    return ", ".join(parts)


def result_text(result: StepResult) -> str:
    """Return the problems of a step's result."""
    wrong = [
        f"{measure.name} {measure.text()} ({measure.range_text()} is right)"
        for measure in result.measures
        if not measure.is_right
    ]
    return "; ".join(filter(None, [result.problem, *wrong]))
