"""The page while a commissioning, a twin, tests or a campaign run."""

import pytest
from support.axe import serious_problems
from support.live_bench import live_bench, panel
from support.live_work import live_work
from support.patience import GUARD

from hil_bench.abilities.common.work import (
    Band,
    Course,
    Failure,
    Histogram,
    WorkItem,
    WorkMargin,
    WorkState,
)

pytestmark = [pytest.mark.browser, pytest.mark.usefixtures("folder")]
expect = pytest.importorskip("playwright.sync_api").expect

RAMP = WorkState(
    now="ramp",
    detail="position 10 to 190 mm, time to 30 s",
    done=2,
    total=3,
    counts={"passed": 1, "failed": 1},
    items=[
        WorkItem("sensors", "passed"),
        WorkItem("<b>direction</b>", "failed", "sign -1 (1 is right)"),
        WorkItem("ramp", "runs"),
    ],
    limits={"axis1.position": (0.01, 0.19), "axis1.P_A": (0.0, 100e5)},
)


def show_rows(feed, count=400):
    for number in range(count):
        pressure = 95e5 if number > count // 2 else 50e5
        feed.put_row((0.01 * number, 0.05, pressure, pressure + 1e5, 2.0))


def test_a_commissioning_shows_step_limits_and_values_and_stops(pages, keep):
    with live_work() as (feed, stopped), panel() as port:
        feed.show(RAMP)
        page = pages.open(port)
        work = page.locator("#view-work")
        expect(work.locator(".work-now")).to_have_text("ramp")
        assert page.locator("[role=tab]:visible").all_inner_texts() == ["Scope", "Commission"]
        expect(page.locator("#banner")).to_be_hidden()
        feed.wait_for_client(GUARD)
        show_rows(feed)
        position = work.get_by_role("row", name="axis1.position [mm]")
        expect(position).to_contain_text("50.00")
        expect(position).to_contain_text("10.00")
        expect(position).to_contain_text("190.00")
        # 95 bar are within a tenth of the range of the limit of 100 bar, 50 mm are not.
        expect(work.locator("tr.loud th")).to_have_text("axis1.P_A [bar]")
        parts = work.get_by_role("region", name="parts and findings")
        expect(parts).to_contain_text("<b>direction</b>")
        expect(work.get_by_text("2 of 3")).to_be_visible()
        expect(page.locator("#brief")).to_have_text("2 of 3")
        keep(page, "work-commission")
        work.get_by_role("button", name="Stop").click()
        assert stopped.wait(GUARD)


def test_its_verdict_stays_when_it_has_ended(pages):
    with panel() as port:
        with live_work("shadow") as (feed, _):
            feed.show(WorkState(now="axis1: the twin follows"))
            page = pages.open(port)
            expect(page.locator(".work-now")).to_have_text("axis1: the twin follows")
            feed.show(WorkState(verdict="differs", items=[WorkItem("axis1 P_A", "differs")]))
        expect(page.locator("#banner")).to_contain_text("bench shadow has ended")
        expect(page.locator(".work-now")).to_have_text("done: differs")
        expect(page.locator("#view-work td.bad")).to_have_text("differs")


def test_a_campaign_has_no_channels_and_no_time_that_stands_still(pages, keep):
    state = WorkState(done=700, total=1000, counts={"passed": 690, "failed": 10})
    with live_work("campaign", []) as (feed, _), panel() as port:
        feed.show(state)
        page = pages.open(port)
        expect(page.locator("#view-work")).to_contain_text("10 failed")
        assert page.locator("[role=tab]:visible").all_inner_texts() == ["Campaign"]
        expect(page.locator("#view-work .values")).to_be_hidden()
        keep(page, "work-campaign")


def test_work_and_a_bench_are_chosen_from_each_other(pages):
    with live_bench(), panel() as port:
        page = pages.open(port)
        expect(page.locator("#bench-name")).to_have_text("bench")
        picker = page.get_by_label("which bench")
        expect(picker).to_be_hidden()
        with live_work() as (feed, _):
            feed.show(RAMP)
            picker.select_option("commission")
            expect(page.locator("#bench-name")).to_have_text("commission")
            expect(page.locator(".work-now")).to_have_text("ramp")
            expect(page.locator("#tab-machine")).to_be_hidden()
            picker.select_option("bench")
            expect(page.locator("#tab-machine")).to_be_visible()
            expect(page.locator("#tab-work")).to_be_hidden()
        expect(picker).to_be_hidden()


def test_keys_go_to_the_views_that_are_there(pages):
    with live_work() as (feed, _), panel() as port:
        feed.show(RAMP)
        page = pages.open(port)
        expect(page.locator("#view-work")).to_be_visible()
        page.keyboard.press("1")
        expect(page.locator("#view-scope")).to_be_visible()
        page.keyboard.press("ArrowRight")
        expect(page.locator("#view-work")).to_be_visible()
        page.keyboard.press("3")
        expect(page.locator("#view-work")).to_be_visible()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_everybody_can_use_it_on_a_small_screen(pages, scheme, keep):
    with live_work() as (feed, _), panel() as port:
        feed.show(RAMP)
        page = pages.open(port, color_scheme=scheme, viewport={"width": 1024, "height": 768})
        expect(page.locator("#view-work")).to_contain_text("1 failed")
        feed.wait_for_client(GUARD)
        show_rows(feed)
        expect(page.locator("tr.loud")).to_be_visible()
        assert page.locator("html").evaluate("html => html.scrollWidth") <= 1024
        keep(page, f"work-{scheme}-1024")
        assert serious_problems(page) == []


MARGINS = WorkState(
    now="moves",
    done=1.2,
    total=2.5,
    unit="s",
    margins=[
        WorkMargin("SRS-1", "", 0.25, "2.5 mm, since 1.10 s", [Band("axis1.position", None, 0.07)]),
        WorkMargin("SRS-2", "failed", -0.01, "-0.1 mm, since 0.30 s"),
        WorkMargin("SRS-3", "", None, ""),
    ],
)


def test_a_scenario_shows_its_margins_and_their_bands_while_it_runs(pages, keep):
    with live_work("scenario") as (feed, _), panel() as port:
        feed.show(MARGINS)
        page = pages.open(port)
        work = page.locator("#view-work")
        expect(work.get_by_text("1.2 of 2.5 s")).to_be_visible()
        rows = work.locator(".margins tbody tr")
        expect(rows.nth(0)).to_contain_text("holds")
        expect(rows.nth(0)).to_contain_text("25 %")
        expect(rows.nth(1)).to_contain_text("failed")
        expect(rows.nth(1)).to_contain_text("-0.1 mm, since 0.30 s")
        expect(rows.nth(2)).to_contain_text("open")
        expect(rows.nth(1).get_by_role("img")).to_have_accessible_name(
            "margin of SRS-2: \u22121 % of the tolerance"
        )
        feed.wait_for_client(GUARD)
        show_rows(feed)
        page.wait_for_function("() => hilBench.model.store.count === 400")
        bands = """() => {
          const { view } = hilBench.views.find(({ id }) => id === 'work');
          const pane = view.plots.panes.find(({ unit }) => unit === 'm');
          return view.plots.bands(pane).map(({ id, low, high, isBad }) => [id, low, high, isBad]);
        }"""
        ((name, low, high, is_bad),) = page.evaluate(bands)
        assert (name, low, is_bad) == ("SRS-1", None, False)
        assert high == pytest.approx(70.0)  # 0.07 m in mm
        keep(page, "work-scenario")


RUNS = WorkState(
    done=700,
    total=1000,
    unit="runs",
    left=95.0,
    counts={"passed": 690, "failed": 10},
    histograms=[Histogram("settling SRS-1", -0.2, 0.6, [1, 0, 9, 600, 80], below=4, above=6)],
    courses=[Course("settling SRS-1", [(1, 0.8), (40, 0.1), (70, -0.3), (700, -0.3)])],
    failures=[
        Failure("0f8567fd", "settling target_mm=170", "SRS-1: <b>late</b>", "hil-bench test")
    ],
)


def test_a_campaign_shows_margins_remaining_time_and_failures(pages, keep):
    with live_work("campaign", []) as (feed, _), panel() as port:
        feed.show(RUNS)
        page = pages.open(port)
        work = page.locator("#view-work")
        expect(work.get_by_text("700 of 1000 runs · about 1 min 35 s left")).to_be_visible()
        expect(work.get_by_text("settling SRS-1: margins of 700 runs")).to_be_visible()
        expect(work.get_by_text("4 below \u221220 %")).to_be_visible()
        expect(work.get_by_text("6 above 60 %")).to_be_visible()
        expect(work.get_by_text("best so far \u221230 % of the tolerance")).to_be_visible()
        failed = work.get_by_role("region", name="runs that failed")
        expect(failed).to_contain_text("SRS-1: <b>late</b>")
        assert serious_problems(page) == []
        keep(page, "work-runs")


PICTURE = "data:image/svg+xml;base64,PHN2ZyB4bWxucz0iaHR0cDovL3d3dy53My5vcmcvMjAwMC9zdmciLz4="


def test_a_failure_is_played_again_and_drawn(pages, monkeypatch):
    async def replay(again, key):
        assert again == ["campaign", "/c.toml"]
        verdict = {"id": "SRS-1", "outcome": "failed", "reason": f"run {key} is late"}
        return {"run": {"verdicts": [verdict], "problem": ""}, "picture": PICTURE}

    monkeypatch.setattr("hil_bench.abilities.panel.desk.replay_run", replay)
    with live_work("campaign", [], again=["campaign", "/c.toml"]) as (feed, _), panel() as port:
        feed.show(RUNS)
        page = pages.open(port)
        page.get_by_role("button", name="Replay").click()
        found = page.locator("#view-work .result")
        expect(found).to_contain_text("SRS-1 failed: run 0f8567fd is late")
        expect(found.get_by_role("img")).to_be_attached()
        expect(found).to_contain_text("again in a shell: hil-bench test")
