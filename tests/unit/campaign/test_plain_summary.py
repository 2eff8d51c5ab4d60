"""The words of a campaign, beside sums and counts of the same runs by the plainest loops."""

import math
import random
import re
from statistics import median
from types import SimpleNamespace

import numpy as np
import pytest
from support.campaigns import run_result

from hil_bench.abilities.campaign import reports
from hil_bench.abilities.campaign.records import RunOutcome, Verdict, read_campaign
from hil_bench.abilities.campaign.search import (
    Evolution,
    Find,
    Method,
    SearchResult,
    Trial,
    _find,
    cost_of,
    turns,
)
from hil_bench.abilities.campaign.store import Store
from hil_bench.abilities.campaign.summary import (
    compare,
    correlations,
    count_outcomes,
    failure_bound,
    summarise,
    worst_runs,
)
from hil_bench.abilities.campaign.verbs.campaign_view import CampaignView
from hil_bench.abilities.common.work import WorkView
from hil_bench.errors import ConfigError

NEVER_DECIDED = ("inconclusive", "not exercised")
ORDER = ("crashed", "timed out", "failed", "inconclusive", "not exercised", "passed")


def some_runs(seed, count=60):
    dice = random.Random(seed)  # noqa: S311 - no secrets
    runs = []
    for number in range(count):
        scenario = dice.choice(("s", "t"))
        values = {"a": dice.choice((0.0, 1.0, 2.5)), "b": dice.random() * 1e3}
        problem = dice.choice(("", "", "", "", "", "it crashed"))
        verdicts = []
        for name in ("R1", "R2", "R3") if not problem else ():
            outcome = dice.choice(("passed", "passed", "failed", *NEVER_DECIDED))
            size = values["b"] / 1e3 + dice.random() if name == "R1" else 5 * dice.random()
            margin = dice.choice((None, size, size, size))
            if outcome == "failed" and margin is not None:
                margin = -margin
            seen = dice.choice((None, 1.0, dice.random()))
            verdicts.append(Verdict(name, outcome, margin, f"{name} is so", seen))
        found = [each.outcome for each in verdicts] or [dice.choice(("crashed", "timed out"))]
        outcome = RunOutcome(min(found, key=ORDER.index))
        key, more = f"{number:08x}", {"scenario": scenario, "values": values, "problem": problem}
        runs.append(run_result(*verdicts, outcome=outcome, key=key, **more))
    return runs


def verdict(run, name):
    return {each.id: each for each in run.verdicts}.get(name)


def decided(run, name):
    found = verdict(run, name)
    return found if found is not None and found.outcome in {"passed", "failed"} else None


def failed(run, name):
    found = verdict(run, name)
    return found is not None and found.outcome == "failed"


def smallest(run, default):
    """The smallest margin of a run among its decided requirements."""
    found = [decided(run, name) for name in ("R1", "R2", "R3")]
    return min([d.margin for d in found if d and d.margin is not None], default=default)


def sized(runs, name):
    return [(r, d.margin) for r in runs if (d := decided(r, name)) and d.margin is not None]


def pearson(pairs):
    (x, y), n = zip(*pairs, strict=True), len(pairs)
    dx, dy = [e - sum(x) / n for e in x], [e - sum(y) / n for e in y]
    part = sum(a * b for a, b in zip(dx, dy, strict=True))
    return part / math.sqrt(sum(a * a for a in dx) * sum(b * b for b in dy))


def ranks(values):
    """Ranks from 1; equal values share their mean."""
    return [sum(o < v for o in values) + (sum(o == v for o in values) + 1) / 2 for v in values]


@pytest.mark.parametrize(("margin", "shown"), [(5e-324, "+0"), (-5e-324, "-0"), (0.792, "+0.79")])
def test_equal_sides_have_a_sign_and_no_size(margin, shown):
    (found,) = summarise([run_result(Verdict("R1", "passed", margin, "so", 1.0))])
    assert f"smallest margin {shown} of the tolerance" in found.line()


@pytest.mark.parametrize("seed", range(4))
def test_a_summary_counts_what_the_runs_say(seed):
    runs = some_runs(seed)
    assert count_outcomes(runs) == {
        name: n for name in reversed(ORDER) if (n := sum(r.outcome == name for r in runs))
    }
    worst = sorted(runs, key=lambda r: (ORDER.index(r.outcome), smallest(r, math.inf), r.key))
    assert worst_runs(runs) == worst[:10]
    summaries = {(each.scenario, each.id): each for each in summarise(runs)}
    assert set(summaries) == {(s, r) for s in "st" for r in ("R1", "R2", "R3")}
    for (scenario, name), found in summaries.items():
        own = [r for r in runs if r.scenario == scenario]
        said = [v.outcome if (v := verdict(r, name)) else r.outcome.value for r in own]
        assert dict(found.outcomes) == {o: said.count(o) for o in ORDER if o in said}
        margins = [margin for _, margin in sized(own, name)]
        assert found.margins == tuple(margins)
        seen = [v.seen for r in own if (v := verdict(r, name)) and v.seen is not None]
        assert found.seen == min(seen)
        line = found.line()
        assert f"smallest margin {min(margins):+.2g} of the tolerance" in line
        assert f"seen at least {100 * min(seen):.3g} % of its time" in line
        assert (found.failures, found.tally.passed) == (said.count("failed"), said.count("passed"))
        assert found.tally.runs == len(own)
    for each in (found := correlations(runs)):
        own = [r for r in runs if r.scenario == each.scenario]
        pairs = [(r.values[each.parameter], margin) for r, margin in sized(own, each.requirement)]
        assert each.runs == len(pairs) >= 10
        x, y = zip(*pairs, strict=True)
        assert each.rank == pytest.approx(pearson(list(zip(ranks(x), ranks(y), strict=True))))
    assert [abs(each.rank) for each in found] == sorted((abs(e.rank) for e in found), reverse=True)
    enough = {(s, n) for s, n in summaries if len(summaries[s, n].margins) >= 10}
    assert {(e.scenario, e.requirement) for e in found} == enough


def test_ten_runs_are_enough_for_a_correlation_and_one_value_is_not():
    def run(number, a):
        values = {"a": a, "b": float(-number)}
        return run_result(Verdict("R1", "passed", float(number), ""), values=values)

    assert correlations([run(n, 1.0) for n in range(9)]) == []
    (only,) = correlations([run(n, 1.0) for n in range(10)])
    assert (only.parameter, only.runs, only.rank) == ("b", 10, pytest.approx(-1.0))


@pytest.mark.parametrize(("failed", "runs"), [(0, 1), (0, 59), (1, 20), (3, 7), (7, 7), (9, 9)])
def test_a_bound_leaves_five_percent_to_as_few_failures(failed, runs):
    bound = failure_bound(failed, runs)
    if failed == runs:
        assert bound == 1.0
        return
    chance = sum(
        math.comb(runs, k) * bound**k * (1 - bound) ** (runs - k) for k in range(failed + 1)
    )
    assert chance == pytest.approx(0.05)


@pytest.mark.parametrize("seed", range(3))
def test_two_campaigns_differ_in_what_their_common_runs_say(seed):
    before = some_runs(seed)
    others = some_runs(seed + 100)
    now = [
        o._replace(scenario=b.scenario, values=b.values)
        for b, o in zip(before[5:], others, strict=False)
    ]
    changes = {(each.scenario, each.id): each for each in compare(before, now)}
    assert len(changes) == 6
    for (scenario, name), change in changes.items():
        pairs = [(b, n) for b, n in zip(before[5:], now, strict=False) if b.scenario == scenario]
        both = [(b, n) for b, n in pairs if decided(b, name) and decided(n, name)]
        broken = [n for b, n in pairs if failed(n, name) and not failed(b, name)]
        mended = [n for b, n in both if failed(b, name) and not failed(n, name)]
        assert (change.runs, change.undecided) == (len(pairs), len(pairs) - len(both))
        assert (list(change.broken), list(change.mended)) == (broken, mended)
        known = [(decided(b, name).margin, decided(n, name).margin) for b, n in both]
        known = [each for each in known if None not in each]
        assert change.margins == (median(b for b, _ in known), median(n for _, n in known))
        line = f"of {len(pairs)} common runs {len(broken)} newly failed, {len(mended)} no longer"
        assert line in change.line()
        assert f", {len(pairs) - len(both)} not decided before or now; median" in change.line()


def cost(run, names):
    if run.outcome in {"crashed", "timed out"}:
        return -2.0
    costs = []
    for each in run.verdicts:
        if each.id in names:
            size = each.margin
            if size is None:
                size = -1.0 if each.outcome == "failed" else 1.0
            costs.append(size if each.outcome in {"passed", "failed"} else max(size, 2.0))
    return min(costs, default=2.0)


@pytest.mark.parametrize("seed", range(3))
def test_a_search_keeps_the_first_failure_and_the_worst_of_each_requirement(seed):
    dice = random.Random(seed)  # noqa: S311 - no secrets
    counts = dict.fromkeys(Method, 0)
    trials = []
    for run in some_runs(seed):
        method = dice.choice(list(Method))
        counts[method] += 1
        trials.append(Trial(method, counts[method], run.values, run))
    for name in ("R1", "R2", "R3"):
        found = _find(name, trials)
        bad = [t for t in trials if failed(t.result, name)]
        first = {m: min(t.number for t in bad if t.method is m) for m in {t.method for t in bad}}
        margins = [cost(t.result, [name]) for t in trials if decided(t.result, name)]
        assert (found.first, found.is_failed) == (first, True)
        assert found.margin == min(margins) == found.worst.margin(name)
        assert found.tally.runs == len(trials)
    for names in (["R1"], ["R2", "R3"], ["R9"]):
        for trial in trials:
            assert cost_of(trial.result, names) == cost(trial.result, names)
    result = SearchResult(tuple(trials), ())
    cut = [t for t in trials if t.result.outcome in {"crashed", "timed out"}]
    assert list(result.crashes) == cut
    assert sum(len(result.of(method)) for method in Method) == len(trials)
    assert _find("R9", trials)[1:4] == ({}, None, math.inf)


def test_a_search_turns_to_what_has_not_failed():
    expected = {"": ["abc", "a", "b", "c"], "b": ["ac", "a", "c"], "ab": ["c"], "abc": ["abc"]}
    assert {
        failed: ["".join(each) for each in turns("abc", failed)] for failed in expected
    } == expected


class Watched(WorkView):
    is_watched = True


@pytest.mark.parametrize("seed", range(2))
def test_who_watches_a_campaign_sees_its_counts_and_the_worst_first(seed):
    runs, view = some_runs(seed, 50), Watched()
    times = iter([0.0] + [0.49] * 1000)
    shown = CampaignView(
        view, 60, lambda run: f"again {run.key}", is_search=True, clock=lambda: next(times)
    )
    for run in runs:
        shown.note(run)
    assert (view.state.done, view.state.items) == (0, ())  # half a second has not passed
    shown.show()
    state = view.state
    assert (state.done, state.counts) == (50, count_outcomes(runs))
    wrong = [r for r in runs if r.outcome in {"failed", "crashed", "timed out"}]
    margin = {r.key: smallest(r, -math.inf) for r in wrong}
    assert [each.command[6:] for each in state.failures] == sorted(margin, key=margin.get)
    texts = {each.command[6:]: each.text for each in state.failures}
    for run in wrong:
        reasons = [f"{v.id}: {v.id} is so" for v in run.verdicts if v.outcome == "failed"]
        assert texts[run.key] == (run.problem or "; ".join(reasons))
    histograms = {each.name: each for each in state.histograms}
    courses = {each.name: each.points for each in state.courses}
    items = {each.name: each for each in state.items}
    for scenario in "st":
        for name in ("R1", "R2", "R3"):
            own = [r for r in runs if r.scenario == scenario]
            margins = [margin for _, margin in sized(own, name)]
            found, label = histograms[f"{scenario} {name}"], f"{scenario} {name}"
            counts = (sum(found.counts), found.below, found.above)
            assert counts == (
                sum(abs(m) <= 3 for m in margins),
                sum(m < -3 for m in margins),
                sum(m > 3 for m in margins),
            )
            best, course = math.inf, []
            for number, run in enumerate(runs, 1):
                if (
                    run.scenario == scenario
                    and (d := decided(run, name))
                    and d.margin is not None
                    and d.margin < best
                ):
                    best = d.margin
                    course.append((float(number), best))
            assert courses[label] == [*course, (50.0, best)]
            bad = [r for r in own if failed(r, name)]
            worst = min(bad, key=lambda r, n=name: cost(r, [n]))
            size, where = verdict(worst, name).margin, f"at a={worst.values['a']:.5g}, b="
            text = "" if size is None else f"smallest margin {100 * size:+.0f} % of the tolerance "
            assert items[label].verdict == "failed"
            assert items[label].text.startswith(text + where)


@pytest.fixture
def drawn(monkeypatch):
    """Keep the axes of a figure in place of its picture."""
    kept = []
    monkeypatch.setattr(reports, "svg_of", lambda figure: kept.extend(figure.axes) or "a figure")
    return kept


def test_a_figure_of_margins_has_each_margin_in_the_bin_where_it_lies(drawn):
    margins = [-7.0, -3.0, -0.51, -0.49, -0.001, 0.0, 0.001, 0.3, 2.9, 3.0, 3.5, 8.0]
    reports.margin_figure(margins)
    (axes,) = drawn
    bars = {each.get_label(): list(each) for each in axes.containers}
    assert set(bars) == {"holds (7)", "fails (5)", "below -300 % (1)", "above 300 % (2)"}
    for label, side in (("holds (7)", 1), ("fails (5)", -1)):
        for bar in bars[label]:
            low, high = bar.get_x() / 100, (bar.get_x() + bar.get_width()) / 100
            inside = [m for m in margins if low - 1e-9 <= m < high - 1e-9 and abs(m) <= 3]
            assert bar.get_height() == len(inside), (low, high)
            assert side * (low + high) > 0
        assert sum(bar.get_height() for bar in bars[label]) == (6 if side > 0 else 4) - (side > 0)
    assert bars["below -300 % (1)"][0].get_height() == 1
    assert bars["above 300 % (2)"][0].get_height() == 2
    assert bars["below -300 % (1)"][0].get_x() < min(bar.get_x() for bar in bars["fails (5)"])


def test_a_figure_of_a_search_has_the_best_so_far_of_each_method(drawn):
    def trial(method, number, margin):
        outcome = "failed" if margin is not None and margin < 0 else "passed"
        found = [] if margin is None else [Verdict("R1", outcome, margin, "")]
        return Trial(method, number, {}, run_result(*found, outcome="passed"))

    trials = (
        trial(Method.RANDOM, 1, 0.5), trial(Method.RANDOM, 2, 0.75), trial(Method.RANDOM, 3, -0.25),
        trial(Method.CMA_ES, 1, 9.0), trial(Method.CMA_ES, 2, None), trial(Method.CMA_ES, 3, -9.0),
    )  # fmt: skip
    find = Find("R1", {}, None, 0.0, None)
    reports.search_figure(SearchResult(trials, (find,)), "R1")
    (axes,) = drawn
    lines = [(e.get_label(), list(e.get_xdata()), list(e.get_ydata())) for e in axes.lines]
    assert [each[1:] for each in lines if each[0] == "random"] == [([1, 2, 3], [0.5, 0.5, -0.25])]
    assert [each[1:] for each in lines if each[0] == "cma-es"] == [([1, 3], [3.0, -3.0])]
    assert ([1, 2, 3], [0.5, 0.75, -0.25]) in [each[1:] for each in lines]
    assert not [each for each in lines if each[0] == "sobol"]
    assert axes.get_xlabel() == "run (1 below -3 and 1 above 3: shown at the end)"


def test_a_folder_gives_back_the_results_it_was_given(tmp_path):
    runs = some_runs(9, 40)
    store = Store(tmp_path, {}, {"x": 1.5})
    store.write(runs[:25])
    store.write(runs[25:])
    store.write([])
    assert sorted(store.results()) == sorted(runs)
    assert store.keys() == {each.key for each in runs}
    assert len(list(tmp_path.iterdir())) == 2


def test_a_search_starts_anew_at_the_best_it_knows_and_every_second_round_elsewhere(monkeypatch):
    begun = []
    monkeypatch.setattr(Evolution, "_start", lambda _self, mean: begun.append(list(mean)))
    search = Evolution(["R1", "R2"], 2, 1)
    points = np.array([[0.25, 0.5], [0.75, 0.5], [0.5, 0.125]])

    def run(one, two):
        margins = {"R1": one, "R2": two}
        return run_result(*(Verdict(name, "passed", each, "") for name, each in margins.items()))

    search.tell(points, [run(0.5, 0.5), run(0.3, 0.9), run(0.9, 0.2)])
    # Turns: both, R1, R2; a round has three. The first start is for both.
    for _ in range(8):
        search._restart()
    both, first, second = [0.5, 0.125], [0.75, 0.5], [0.5, 0.125]
    assert [begun[place] for place in (0, 1, 2, 6, 7, 8)] == [both, first, second] * 2
    elsewhere = begun[3:6]
    assert not [each for each in elsewhere if each in points.tolist()]
    assert len({tuple(each) for each in elsewhere}) == 3


def test_the_report_of_a_search_says_where_its_smallest_margin_is(tmp_path, drawn):
    verdicts = (Verdict("R1", "failed", -0.25, ""), Verdict("R2", "inconclusive", None, ""))
    run = run_result(*verdicts)
    trials = (Trial(Method.SOBOL, 3, {"a": 1.5}, run),)
    finds = tuple(_find(name, trials) for name in ("R1", "R2"))
    scenario = SimpleNamespace(title="A title", path="a.scenario.toml")
    plan = SimpleNamespace(methods=(Method.SOBOL, Method.RANDOM), seed=7, given={"b": 2.0})
    found = SimpleNamespace(
        search=SearchResult(trials, finds),
        plan=plan,
        case=SimpleNamespace(scenario=scenario),
        failures=(),
        lines=lambda: ["a line"],
    )
    reports.write_search_report(tmp_path / "report.html", found)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    words = " ".join(re.sub(r"<[^>]*>", " ", text.partition("<body")[2]).split())
    assert "a.scenario.toml , seed 7, b = 2.0: 1 runs of sobol, 0 runs of random." in words
    assert "R1 fails run 3 none -0.25 a=1.5 R2 never decided none none" in words
    assert words.count("a figure") == 1
    assert "R2 never decided none none R1 a figure" in words
    assert len(drawn) == 1


@pytest.mark.parametrize(
    ("line", "field", "value"),
    [
        ("", "runs", 64),
        ("", "levels", 5),
        ("", "seed", 0),
        ("", "timeout", 60.0),
        ("", "seeds", ()),
        ("", "seed_each", False),
        ("runs = 1", "runs", 1),
        ("runs = 10_000_000", "runs", 10_000_000),
        ("levels = 1000", "levels", 1000),
        ("timeout_s = 0.1", "timeout", 0.1),
        ("timeout_s = 1e6", "timeout", 1e6),
        ('seeds = "each"', "seed_each", True),
        ('seeds = "each"', "seeds", ()),
        ("seeds = [3, 0]", "seeds", (3, 0)),
        ("seeds = [3, 0]", "seed_each", False),
        ("runs = 10_000_001", None, "runs"),
        ("runs = 0", None, "runs"),
        ("levels = 1001", None, "levels"),
        ("levels = 0", None, "levels"),
        ("seed = -1", None, "seed"),
        ("seeds = []", None, "seeds"),
        ("seeds = [-1]", None, "seeds"),
        ("timeout_s = 0.09", None, "timeout_s"),
        ("timeout_s = 1.1e6", None, "timeout_s"),
    ],
)
def test_a_campaign_has_its_defaults_and_takes_its_limits(make_file, line, field, value):
    path = make_file("a.campaign.toml", f'scenarios = ["x.scenario.toml"]\n{line}\n')
    if field is None:
        with pytest.raises(ConfigError, match=value):
            read_campaign(path)
    else:
        assert getattr(read_campaign(path), field) == value
