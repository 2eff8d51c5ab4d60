"""A campaign for those who watch: its remaining time (the rest is in test_plain_summary)."""

from support.campaigns import run_result

from hil_bench.abilities.campaign.records import Verdict
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


def run(margin):
    return run_result(Verdict("R1", "passed" if margin >= 0.0 else "failed", margin, "late"))


def test_the_time_that_is_left_is_that_of_the_runs_to_come():
    view, clock = Watched(), Clock()
    shown = CampaignView(view, 5, clock=clock)
    for clock.now in (2.0, 4.0):
        shown.note(run(0.5))
    assert view.state.left == 6.0  # two runs of 2 s each are done, three are left


def test_runs_that_were_done_before_say_nothing_of_the_pace():
    view, clock = Watched(), Clock()
    shown = CampaignView(view, 4, clock=clock)
    shown.note(None)
    clock.now = 2.0
    shown.note(run(0.5))
    assert view.state.left == 4.0
    assert view.state.counts == {"done before": 1, "passed": 1}


def test_runs_are_counted_with_those_that_fail():
    work = Work("campaign", 4, "runs")
    note = count_runs(work)
    for result in (None, run(0.5), run(-0.5), run(-0.1)):
        note(result)
    assert (work.done, work.remark) == (4, "2 failed")
