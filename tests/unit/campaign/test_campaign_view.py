"""A campaign for those who watch: remaining time, histograms, failures, and the best so far."""

from hil_bench.abilities.campaign.records import RunOutcome, RunResult, Verdict
from hil_bench.abilities.campaign.verbs.campaign_view import CampaignView, count_runs
from hil_bench.abilities.common.progress import Work
from hil_bench.abilities.common.work import WorkView


class Watched(WorkView):
    """A view that somebody watches."""

    is_watched = True


class Clock:
    """A clock that a test moves [s]."""

    now = 0.0

    def __call__(self):
        return self.now


def verdict(margin):
    outcome = "passed" if margin >= 0.0 else "failed"
    return Verdict("R1", outcome, margin, "late")


def run(number, margin):
    outcome = RunOutcome.PASSED if margin >= 0.0 else RunOutcome.FAILED
    values = {"target_mm": float(number)}
    found = (verdict(margin),)
    return RunResult(f"{number:08x}", "s", "", "", None, values, outcome, verdicts=found)


def watched(margins, total, **options):
    view, clock = Watched(), Clock()
    shown = CampaignView(view, total, lambda each: f"again {each.key}", clock=clock, **options)
    for number, margin in enumerate(margins, 1):
        clock.now = 2.0 * number
        shown.note(run(number, margin))
    return view.state


def test_the_time_that_is_left_is_that_of_the_runs_to_come():
    # Two runs of 2 s each are done, three are left.
    assert watched([0.5, 0.5], 5).left == 6.0


def test_runs_that_were_done_before_say_nothing_of_the_pace():
    view, clock = Watched(), Clock()
    shown = CampaignView(view, 4, clock=clock)
    shown.note(None)
    clock.now = 2.0
    shown.note(run(1, 0.5))
    assert view.state.left == 4.0
    assert view.state.counts == {"done before": 1, "passed": 1}


def test_failures_come_the_worst_first_with_what_repeats_them():
    state = watched([0.5, -0.2, -0.7, 0.1], 4)
    assert [each.command for each in state.failures] == ["again 00000003", "again 00000002"]
    assert state.failures[0].name == "s target_mm=3"
    assert state.failures[0].text == "R1: late"


def test_every_margin_is_in_the_histogram():
    (histogram,) = watched([0.5, -0.2, -7.0, 0.1], 4).histograms
    assert histogram.name == "s R1"
    assert (sum(histogram.counts), histogram.below, histogram.above) == (3, 1, 0)


def test_runs_are_counted_with_those_that_fail():
    work = Work("campaign", 4, "runs")
    note = count_runs(work)
    for result in (None, run(1, 0.5), run(2, -0.5), run(3, -0.1)):
        note(result)
    assert (work.done, work.remark) == (4, "2 failed")


def test_a_search_shows_its_best_so_far():
    (course,) = watched([0.5, 0.7, -0.2, 0.1], 4, is_search=True).courses
    assert course.points == [(1.0, 0.5), (3.0, -0.2), (4.0, -0.2)]
    assert watched([0.5], 1).courses == []
