"""Rows and channels that nobody expects, and two people on two pages: a line, and it goes on."""

import math

import pytest
from support.live_bench import live_bench, panel
from support.live_work import live_work
from support.patience import GUARD

from hil_bench.abilities.common.work import WorkState

pytestmark = [pytest.mark.browser, pytest.mark.usefixtures("folder")]
expect = pytest.importorskip("playwright.sync_api").expect

MANY = 10_000
VIEW = "hilBench.views.find(({ id }) => id === 'scope').view"


def test_ten_thousand_channels_are_searched_and_the_page_keeps_its_memory(pages):
    with live_work("shadow", [[f"s{number}", "m"] for number in range(MANY)]) as (feed, _):
        feed.show(WorkState(now="follows"))
        with panel() as port:
            page = pages.open(port)
            page.locator("#tab-scope").click()
            scope = page.locator("#view-scope")
            expect(
                scope.get_by_text(f"{MANY - 300} more channels; search for them")
            ).to_be_visible()
            feed.wait_for_client(GUARD)
            feed.put_row([0.1, *[0.05] * MANY])
            expect(scope.locator(".legend-value").first).to_have_text("50.00")
            scope.get_by_label("search channels").fill("s9999")
            scope.get_by_label("s9999").check()
            expect(scope.locator(".legend-item").filter(has_text="s9999")).to_contain_text("50.00")
            # A value has 4 bytes there; what all channels keep is bounded.
            most = page.evaluate("() => hilBench.model.store.rows * 2 * 4")
            assert most * MANY <= 1 << 28


def test_values_that_are_no_numbers_are_gaps(pages):
    with live_work("shadow", [["a", "m"], ["b", "Pa"]]) as (feed, _), panel() as port:
        feed.show(WorkState(now="follows"))
        page = pages.open(port)
        page.locator("#tab-scope").click()
        scope = page.locator("#view-scope")
        expect(scope.locator(".legend-item").first).to_be_visible()
        feed.wait_for_client(GUARD)
        for number, value in enumerate([0.01, math.nan, math.inf, -math.inf]):
            feed.put_row((0.1 * number, value, 1e5))
        expect(scope.locator(".legend-value").first).to_have_text("no value")
        feed.put_row((0.5, 0.02, math.nan))
        expect(scope.locator(".legend-value").first).to_have_text("20.00")
        assert page.evaluate(f"() => {VIEW}.plots.panes[0].plot.data[1]") == [
            *[pytest.approx(10.0)],
            *[None] * 3,
            pytest.approx(20.0),
        ]


def test_time_that_goes_back_is_not_shown(pages):
    with live_work("shadow", [["a", "m"]]) as (feed, _), panel() as port:
        feed.show(WorkState(now="follows"))
        page = pages.open(port)
        expect(page.locator("#view-work")).to_contain_text("follows")
        feed.wait_for_client(GUARD)
        for time in (1.0, 0.5, 1.0, 2.0):
            feed.put_row((time, time))
        page.wait_for_function("() => hilBench.model.store.last === 2")
        assert page.evaluate("() => hilBench.model.store.count") == 2


def test_a_channel_that_vanishes_with_the_next_bench_leaves_the_plots(pages):
    with panel() as port:
        page = pages.open(port)
        with live_work("shadow", [["a", "m"], ["gone", "m"]]) as (feed, _):
            feed.show(WorkState(now="follows"))
            page.locator("#tab-scope").click()
            scope = page.locator("#view-scope")
            expect(scope.locator(".legend-item").filter(has_text="gone")).to_be_visible()
        with live_work("shadow", [["a", "m"]]) as (feed, _):
            feed.show(WorkState(now="follows"))
            expect(scope.locator(".legend-item").filter(has_text="gone")).to_have_count(0)
            feed.wait_for_client(GUARD)
            feed.put_row((0.1, 0.05))
            expect(scope.locator(".legend-value")).to_have_text("50.00")


def test_two_people_who_set_the_same_value_hear_of_each_other(pages):
    with live_bench(), panel() as port:
        ours, theirs = pages.open(port), pages.open(port)
        for page in (ours, theirs):
            page.wait_for_function("() => hilBench.model.store.count > 0")
        ask = """(value) =>
          hilBench.model.request('set_plant', { axis: 'axis1', quantity: 'load', value })"""
        ours.evaluate(ask, 1000)
        expect(theirs.locator("#others")).to_contain_text("somebody else, at")
        expect(theirs.locator("#others")).to_contain_text("axis1.load = 1000")
        expect(ours.locator("#others")).to_be_hidden()
        theirs.evaluate(ask, 2000)
        expect(ours.locator("#others")).to_contain_text("axis1.load = 2000")
        expect(theirs.locator("#others")).to_contain_text("1000")  # its own is no news
