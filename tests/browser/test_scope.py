"""The scope: trigger, cursors, zoom, shades and marks, and spikes that survive any zoom."""

import re

import pytest

from hil_bench.abilities.faults.faults import Faults
from hil_bench.canopen_device.nmt import NmtCommand

pytestmark = pytest.mark.browser
expect = pytest.importorskip("playwright.sync_api").expect


@pytest.fixture
def scope(page):
    page.locator("#tab-scope").click()
    scope = page.locator("#view-scope")
    expect(scope.locator(".legend-value").first).to_have_text("0.00")
    scope.get_by_text("Trigger").click()
    return scope


def arm(scope, what, condition=None, level=None):
    scope.get_by_label("channel of the trigger").select_option(label=what)
    if condition is not None:
        scope.get_by_label("condition of the trigger").select_option(label=condition)
        scope.get_by_label("level, in the unit shown").fill(str(level))
    scope.get_by_label("armed").check()


def wait_for_trigger(scope):
    """Wait until it has fired; return the time [s] at which it did: a fifth of the window."""
    expect(scope.get_by_role("button", name="Live")).to_be_visible()
    expect(scope.get_by_label("armed")).not_to_be_checked()
    return scope.evaluate(
        "() => { const { view } = hilBench.views.find(({ id }) => id === 'scope');"
        " return view.begin_s + 0.2 * view.span; }"
    )


def test_an_edge_triggers_at_the_tick_that_crosses(scope, bench):
    # At rest P_A is near 50 bar; 20 bar more cross 60 bar.
    arm(scope, "pressure_a.measured [bar]", "rises above", 60)
    bench.session.bench.part(Faults).offset(
        "pressure_a", amount=20e5, at=bench.session.now * 1e-9 + 0.2
    )
    time = wait_for_trigger(scope)
    (event,) = bench.session.bench.part(Faults).events
    # A chain of the sensor may take some milliseconds; the tick after is the least.
    assert event.time <= round(time * 1e9) < event.time + 50_000_000


def test_a_level_triggers_at_once_where_it_is_reached_already(scope):
    arm(scope, "axis1.P_A [bar]", "rises above", 10)
    scope.get_by_label("condition of the trigger").select_option(label="is above")
    wait_for_trigger(scope)


def start_node(bench):
    bench.session.bench.nodes[0]._obey(NmtCommand.START)


@pytest.mark.parametrize(
    ("what", "happen"),
    [
        ("a fault begins", lambda bench: bench.session.bench.part(Faults).freeze("pressure_b")),
        ("an EMCY comes", lambda bench: bench.session.bench.part(Faults).break_wire("position")),
        ("a node changes its state", start_node),
    ],
)
def test_an_event_triggers(scope, bench, what, happen):
    arm(scope, what)
    expect(scope.get_by_label("level, in the unit shown")).to_be_disabled()
    happen(bench)
    assert wait_for_trigger(scope) == pytest.approx(bench.session.now * 1e-9, abs=5.0)


def test_a_mark_triggers_and_is_drawn(page, scope):
    arm(scope, "a mark is set")
    page.locator("#tab-faults").click()
    page.locator("#view-faults").get_by_label("text of the mark").fill("here")
    page.get_by_role("button", name="Mark this moment").click()
    page.locator("#tab-scope").click()
    time = wait_for_trigger(scope)
    assert page.evaluate("() => hilBench.model.marks[0].time") == pytest.approx(time, abs=1e-6)


COLOURS = """(times) => {
  const { view } = hilBench.views.find(({ id }) => id === 'scope');
  const { plot } = view.plots.panes[0];
  const { ctx, bbox } = plot;
  const line = ctx.getImageData(0, bbox.top + bbox.height - 5, plot.ctx.canvas.width, 1).data;
  const at = times.map((time) => 4 * (Math.round(plot.valToPos(time, 'x', true)) + 1));
  return at.map((place) => [...line.slice(place, place + 4)]);
}"""


def test_faults_are_shaded_while_they_last(page, scope, bench):
    scope.get_by_label("time shown").select_option("5")
    expect(page.locator("#clock")).to_have_text(re.compile(r"[1-9]\.\d\d s"))
    fault = bench.session.bench.part(Faults).freeze("pressure_b", duration=0.3)
    expect(page.locator("#brief")).to_contain_text("1 fault")
    expect(page.locator("#brief")).to_contain_text("no fault")
    scope.get_by_role("button", name="Pause").click()
    begins = fault.begins * 1e-9
    before, during = page.evaluate(COLOURS, [begins - 0.21, begins + 0.16])
    assert before != during


def test_a_spike_of_one_row_survives_any_zoom(page):
    """120 s at 1 kHz on 500 pixel columns: 240 rows a column."""
    found = page.evaluate(
        """async () => {
          const { Store } = await import('/store.js');
          const store = new Store();
          store.begin([['a', 'm']]);
          for (let row = 0; row < 120000; row += 1) {
            store.push([row / 1000, row === 70001 ? 5 : row === 90001 ? -3 : 1]);
          }
          const [, values] = store.picture([0], 0, 120, 500, [1]);
          return [Math.max(...values), Math.min(...values), values.length];
        }"""
    )
    assert found == [5, -3, 1000]


def test_a_drag_zooms_all_panes_and_a_double_click_goes_live(page, scope):
    expect(page.locator("#clock")).to_have_text(re.compile(r"[1-9]\.\d\d s"))
    box = scope.locator(".u-over").first.bounding_box()
    page.mouse.move(box["x"] + 50, box["y"] + 50)
    page.mouse.down()
    page.mouse.move(box["x"] + 150, box["y"] + 60, steps=4)
    page.mouse.up()
    expect(scope.get_by_role("button", name="Live")).to_be_visible()
    spans_shown = (
        "hilBench.views.find(({ id }) => id === 'scope').view.plots.panes"
        ".map(({ plot }) => plot.scales.x.max - plot.scales.x.min)"
    )
    page.wait_for_function(f"() => {spans_shown}.every((span) => span < 9)")  # the next picture
    spans = page.evaluate(f"() => {spans_shown}")
    # 100 of the pixels of a window of 10 s.
    assert spans == [pytest.approx(10 * 100 / box["width"], rel=0.03)] * len(spans)
    assert len(spans) == 3
    scope.locator(".u-over").first.dblclick()
    expect(scope.get_by_role("button", name="Pause")).to_be_visible()
