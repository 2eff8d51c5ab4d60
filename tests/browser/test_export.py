"""What the scope exports stands alone, in the units that are shown; frames stand behind markers."""

import csv
import io
from xml.etree import ElementTree as ET

import pytest
from PIL import Image

from hil_bench.abilities.faults.faults import Faults

pytestmark = pytest.mark.browser
expect = pytest.importorskip("playwright.sync_api").expect


@pytest.fixture
def scope(page, bench):
    """The scope, paused, with a fault that has come and gone and both cursors."""
    page.locator("#tab-scope").click()
    scope = page.locator("#view-scope")
    expect(scope.locator(".legend-value").first).to_have_text("0.00")
    page.wait_for_function("() => hilBench.model.hello")
    bench.session.bench.part(Faults).break_wire("position", duration=0.1)
    expect(scope.locator(".events tr").filter(has_text="error reset")).to_be_visible()
    scope.get_by_role("button", name="set A").click()
    scope.get_by_role("button", name="set B").click()
    return scope


def save(page, name):
    with page.expect_download() as caught:
        page.get_by_role("button", name=name, exact=True).click()
    return caught.value.path().read_bytes()


def choose_us(page):
    page.locator(".units summary").click()
    page.get_by_role("button", name="us", exact=True).click()
    page.keyboard.press("Escape")


def test_a_drawing_has_title_units_cursors_faults_and_markers(page, scope):
    expect(scope.locator("tbody th").filter(has_text="axis1.P_A")).to_be_visible()
    root = ET.fromstring(save(page, "SVG"))  # noqa: S314 - our own page made it
    texts = [each.text or "" for each in root.iter("{http://www.w3.org/2000/svg}text")]
    assert texts[0].startswith("bench: ")
    assert any(text.startswith("axis1.P_A [bar]") and "A " in text for text in texts)
    assert "break_wire position" in texts
    assert {"[mm]", "[bar]", "[%]", "A", "B"} <= {*texts}
    assert any("B \u2212 A = 0.00 ms" in text for text in texts)
    titles = [each.text or "" for each in root.iter("{http://www.w3.org/2000/svg}title")]
    assert any("position EMCY 0x1000" in title for title in titles)


@pytest.mark.usefixtures("scope")
def test_a_picture_is_twice_as_large_as_the_drawing(page):
    root = ET.fromstring(save(page, "SVG"))  # noqa: S314 - likewise
    picture = Image.open(io.BytesIO(save(page, "PNG")))
    assert picture.size == (2 * int(root.get("width")), 2 * int(root.get("height")))
    assert len(picture.convert("RGB").getcolors(1 << 24)) > 20


@pytest.mark.usefixtures("scope")
def test_a_table_is_in_the_units_that_are_shown(page):
    metric = list(csv.DictReader(io.StringIO(save(page, "CSV").decode())))
    choose_us(page)
    us = list(csv.DictReader(io.StringIO(save(page, "CSV").decode())))
    # By definition a psi is 4.4482216152605 N on a square of 0.0254 m.
    psi = 4.4482216152605 / 0.0254**2
    assert float(us[0]["axis1.P_A [psi]"]) == pytest.approx(
        float(metric[0]["axis1.P_A [bar]"]) * 1e5 / psi, rel=1e-6
    )
    # The window is not full yet: rows have come in between.
    assert [row["time [s]"] for row in us[: len(metric)]] == [row["time [s]"] for row in metric]


def test_units_stay_when_the_page_is_loaded_again(page, scope):
    choose_us(page)
    expect(scope.get_by_role("columnheader", name="unit")).to_be_visible()
    page.reload()
    expect(page.locator(".units summary")).to_have_text("Units: psi · in · gpm")


def test_a_marker_opens_the_frame_that_it_stands_for(page, scope):
    place = page.evaluate(
        """() => {
          const { view } = hilBench.views.find(({ id }) => id === 'scope');
          const { plot } = view.plots.panes[0];
          const { left, top } = plot.over.getBoundingClientRect();
          const first = view.marks.marks.find(({ meaning }) => meaning.includes('generic'));
          return [left + plot.valToPos(first.time, 'x'), top + 60];
        }"""
    )
    page.mouse.click(*place)
    opened = scope.locator(".events tr[aria-current]")
    expect(opened).to_contain_text("position EMCY")
    expect(opened).to_contain_text("0x1000 generic error")
    expect(opened).to_contain_text("00 10")


def test_the_past_is_looked_at_while_time_goes_on(page):
    page.locator("#tab-scope").click()
    scope = page.locator("#view-scope")
    scope.get_by_label("time shown").select_option("0.5")
    page.wait_for_function("() => hilBench.model.time > 1.5")
    scope.get_by_role("button", name="earlier").click()
    expect(scope.get_by_text("behind, and goes on")).to_be_visible()
    expect(scope.get_by_role("button", name="Pause")).to_be_visible()
    view = "hilBench.views.find(({ id }) => id === 'scope').view"
    before = page.evaluate(f"() => {view}.begin_s")
    page.wait_for_function(f"() => {view}.begin_s > {before} + 0.05")
