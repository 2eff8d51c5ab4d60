"""What goes wrong around a page: sleep, slow lines, clocks that jump. It says so and recovers."""

import itertools
import re

import pytest
from support.live_bench import live_bench, panel

from hil_bench.abilities.common.commands import Mark
from hil_bench.abilities.faults.faults import Faults

pytestmark = pytest.mark.browser
expect = pytest.importorskip("playwright.sync_api").expect

HOUR = 3_600_000  # [ms]


def expect_time_to_pass(page):
    clock = page.locator("#clock")
    expect(clock).to_have_text(re.compile(r"\d+\.\d\d s"))
    before = clock.inner_text()
    expect(clock).not_to_have_text(before)


@pytest.mark.usefixtures("folder")
def test_a_browser_that_was_asleep_for_an_hour_goes_on(pages, monkeypatch):
    with live_bench(), panel() as port:
        page = pages.open(port, clocked=True)
        expect_time_to_pass(page)
        monkeypatch.setattr("hil_bench.abilities.panel.hub.MOST_WAITING", 0)  # it is given up
        page.clock.fast_forward(HOUR)
        expect(page.locator("#banner")).to_contain_text("the panel does not answer")
        monkeypatch.undo()
        page.clock.fast_forward(HOUR)
        expect(page.locator("#banner")).to_be_hidden()
        expect_time_to_pass(page)


@pytest.mark.usefixtures("folder")
def test_rows_after_an_hour_leave_a_gap_and_no_more(pages):
    with live_bench() as bench, panel() as port:
        page = pages.open(port)
        expect_time_to_pass(page)
        page.locator("#tab-scope").click()
        count = len(bench.session.channels)
        later = page.evaluate(
            """(count) => {
              const { link, model } = hilBench;
              const time = model.store.last + 3600;
              link.tell('rows', { rows: [[time, ...new Array(count).fill(0.001)]] });
              return time;
            }""",
            count,
        )
        expect(page.locator("#clock")).to_have_text(f"{later:.2f} s")
        assert page.evaluate("() => hilBench.model.store.first") < 60.0
        view = page.evaluate(
            "() => { const { view } = hilBench.views.find(({ id }) => id === 'scope');"
            " return [view.begin_s, view.end_s]; }"
        )
        assert view == [pytest.approx(later - 10.0), pytest.approx(later)]


@pytest.mark.usefixtures("folder")
def test_the_clock_of_the_computer_may_jump(pages):
    with live_bench(), panel() as port:
        page = pages.open(port, clocked=True)
        expect_time_to_pass(page)
        for moment in ("2001-01-01", "2038-01-20"):
            page.clock.set_system_time(moment)
            expect_time_to_pass(page)
            expect(page.locator("#banner")).to_be_hidden()


@pytest.mark.usefixtures("folder")
def test_a_slow_line_costs_pictures_and_the_page_says_how_many(pages, monkeypatch):
    with live_bench() as bench, panel() as port:
        page = pages.open(port)
        expect_time_to_pass(page)
        monkeypatch.setattr("hil_bench.abilities.panel.hub.MOST_UNREAD", -1)  # nothing may wait
        expect(page.locator("#banner")).to_contain_text("the line to it, is too slow")
        monkeypatch.undo()
        expect(page.locator("#banner")).to_be_hidden()
        expect(page.locator("#brief")).to_contain_text(re.compile(r"this page missed \d+ messages"))
        expect_time_to_pass(page)
        # What it must have comes over any line.
        bench.session.bench.part(Faults).freeze("position")
        expect(page.locator(".active-faults")).to_contain_text("freeze position")


@pytest.mark.usefixtures("folder")
def test_a_panel_that_is_held_up_is_no_bench_that_stands_still(pages):
    with live_bench(), panel() as port:
        page = pages.open(port)
        expect_time_to_pass(page)
        page.evaluate("hilBench.link.socket.onmessage = null")  # nothing comes, nothing closes
        expect(page.locator("#banner")).to_contain_text("the panel has sent nothing since")
        expect(page.locator("body")).to_have_class(re.compile("is-away"))


@pytest.mark.usefixtures("folder")
def test_a_bench_that_is_held_up_is_said_to_be_so(pages):
    with live_bench() as bench, panel() as port:
        page = pages.open(port)
        expect_time_to_pass(page)
        bench.held.set()
        expect(page.locator("#banner")).to_have_text(
            re.compile(r"bench time stands still at .*: its process is held up$")
        )


HOSTILE = [
    "<img src=x onerror=window.hit=1>",
    "\"'><script>window.hit=1</script>",
    "\u202e\u2066reversed",
    "long" * 500,
]


@pytest.mark.usefixtures("folder")
def test_hostile_names_are_text_and_break_no_view(pages):
    """A bench refuses such names; who speaks its feed need not."""
    with live_bench() as plain:
        channels = plain.session.channels
    names = itertools.cycle(HOSTILE)
    hello = {
        "bench": HOSTILE[0],
        "program": HOSTILE[1],
        "nodes": [*HOSTILE, "valve"],
        "devices": {name: {"node_id": 1, "kind": name, "axis": name} for name in HOSTILE},
        "axes": {name: [] for name in HOSTILE},
        "machines": {},
        "channels": [[f"{next(names)}{n}", channel.unit] for n, channel in enumerate(channels)],
    }
    with live_bench(hello=hello) as bench, panel() as port:
        page = pages.open(port)
        expect(page.locator("#clock")).to_have_text(re.compile(r"\d+\.\d\d s"))
        bench.session.door.put(Mark(HOSTILE[0]))
        for tab in page.locator("[role=tab]:visible").all():
            tab.click()
            expect(page.locator("[role=tabpanel]:visible")).to_have_count(1)
            widths = page.evaluate("[document.body.scrollWidth, document.body.clientWidth]")
            assert widths[0] <= widths[1], tab.inner_text()
        assert page.evaluate("window.hit") is None
        assert page.locator("img[src=x]").count() == 0
