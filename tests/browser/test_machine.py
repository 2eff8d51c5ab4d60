"""The picture of the machine: axes by their supply, parts by click and key, hostile pictures."""

import re
from itertools import combinations
from pathlib import Path

import pytest
from support.axe import serious_problems
from support.live_bench import live_bench, panel

from hil_bench import VirtualBench, load_config

expect = pytest.importorskip("playwright.sync_api").expect

pytestmark = pytest.mark.browser

EXAMPLES = Path(__file__).parents[2] / "examples"
CRANE = EXAMPLES / "machines" / "crane.toml"

BOXES = """(selector) => [...document.querySelectorAll(selector)]
  .filter((each) => each.getClientRects().length && each.textContent)
  .map((each) => [each.textContent, each.getBoundingClientRect().toJSON()])"""


def opened(path):
    return live_bench(bench=VirtualBench(load_config(path), recorded_time=0.01, logged_frames=0))


def overlaps(boxes):
    """Return the texts of boxes that cover each other by more than the room between lines."""
    return [
        (one, other)
        for (one, a), (other, b) in combinations(boxes, 2)
        if a["left"] + 1 < b["right"]
        and b["left"] + 1 < a["right"]
        and a["top"] + 4 < b["bottom"]
        and b["top"] + 4 < a["bottom"]
    ]


@pytest.mark.usefixtures("folder")
def test_axes_on_one_supply_are_one_picture_by_keyboard(pages, keep):
    with opened(CRANE) as bench, panel() as port:
        page = pages.open(port, viewport={"width": 1400, "height": 900})
        machine = page.locator("#view-machine")
        cards = machine.locator(".axis-card")
        expect(cards).to_have_text([re.compile("boom"), re.compile("jib")])
        expect(machine.locator(".axis-group.shared")).to_have_count(1)
        expect(machine.locator(".rail")).to_contain_text(re.compile(r"pump: \d+\.\d bar"))
        # crane.toml: the pump senses the load, relief at 210 bar, a counterbalance valve at port A.
        expect(machine.locator(".drawing")).to_contain_text("relief at 210.0 bar")
        expect(machine.locator("title")).to_have_text("counterbalance valve at port A")
        assert overlaps(page.evaluate(BOXES, "#view-machine .drawing text")) == []
        # Picture and plots are on the first screen.
        for part in (machine.locator(".drawing svg"), machine.locator("canvas").last):
            box = part.bounding_box()
            assert box["y"] + box["height"] <= 900
        keep(page, "machine-crane")
        machine.get_by_role("button", name="pump", exact=True).focus()
        page.keyboard.press("Enter")
        inspector = machine.get_by_role("region", name="chosen element")
        expect(inspector).to_contain_text("Supply pump")
        inspector.get_by_role("button", name="Wear pump: pump").click()
        expect(machine.locator(".active-faults")).to_contain_text("wear_pump pump")
        expect(machine.locator(".axis-card.faulty")).to_have_count(2)
        assert [each.kind for each in faults_of(bench)] == ["wear_pump"]
        cards.nth(1).focus()
        page.keyboard.press("Enter")
        expect(page.get_by_role("group", name="drawing of jib")).to_be_visible()
        expect(machine.locator(".legend-item").first).to_contain_text("jib.position")
        assert serious_problems(page) == []


def faults_of(bench):
    from hil_bench.abilities.faults.faults import Faults  # noqa: PLC0415 - for one question

    return bench.session.bench.part(Faults).active


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(("width", "scheme"), [(1400, "light"), (390, "dark")])
def test_sixteen_axes_are_legible(pages, keep, width, scheme):
    with opened(EXAMPLES / "sixteen_axes.toml"), panel() as port:
        page = pages.open(port, color_scheme=scheme, viewport={"width": width, "height": 844})
        cards = page.locator(".axis-card")
        expect(cards).to_have_count(16)
        expect(cards.last).to_contain_text("mm")
        assert overlaps(page.evaluate(BOXES, ".axis-card span")) == []
        size = cards.last.evaluate("each => parseFloat(getComputedStyle(each).fontSize)")
        assert size >= 12
        assert page.locator("html").evaluate("html => html.scrollWidth") <= width
        # The state of the machine, one plot and Stop are on the first screen.
        for part in (".drawing svg", "#view-machine canvas", "#stop"):
            box = page.locator(part).first.bounding_box()
            assert box["y"] >= 0
            assert box["y"] + box["height"] <= 844, part
        keep(page, f"sixteen-{width}")


HOSTILE = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 50" onload="alert(1)">
<script>alert(1)</script><a href="javascript:alert(1)"><text>link</text></a>
<image href="http://192.0.2.1/x.png"/><rect class="mass" width="9" height="9" onclick="alert(1)"
 fill="url(http://192.0.2.1/x)" style="fill:red"/><foreignObject><img src="x"/></foreignObject>
<text y="20" data-text="position"/><text y="40" data-text="nothing"/>
<circle r="1e999" data-x="position 0 0 a b"/></svg>"""


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("svg", "words"),
    [
        (HOSTILE, "0.00 mm"),
        ("<svg", "the picture of this kind is not SVG"),
        ("<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 0 1'/>", "has no viewBox"),
        (f"<svg viewBox='0 0 1 1'>{'<g/>' * 2001}</svg>", "more than 2000 elements"),
    ],
)
def test_of_a_hostile_picture_shapes_and_texts_are_left(pages, svg, words):
    hello = {"machines": {"axis1": {"kind": "odd", "supply": "", "svg": svg}}}
    with live_bench(hello=hello), panel() as port:
        page = pages.open(port)
        drawing = page.locator("#view-machine .drawing")
        expect(drawing).to_contain_text(words)
        for tag in ("script", "a", "image", "img", "foreignObject"):
            assert drawing.locator(tag).count() == 0
        assert drawing.locator("[onclick], [onload], [style*=red], [fill*=url]").count() == 0
    # The browser says that the policy of the page has blocked handlers and styles.
    assert all("Content Security Policy" in each for each in pages.complaints)
    pages.complaints.clear()


def test_the_keys_are_shown_and_stop_ends_the_run(page):
    expect(page.locator("#clock")).not_to_have_text("–")
    page.keyboard.press("?")
    dialog = page.get_by_role("dialog", name="keys of this page")
    expect(dialog).to_contain_text("pause, live")
    page.keyboard.press("3")  # no view changes behind it
    expect(page.locator("#view-machine")).to_be_visible()
    page.keyboard.press("Escape")
    expect(dialog).to_have_count(0)
    page.evaluate(
        "() => { hilBench.requested = [];"
        " hilBench.link.request = async (action) => hilBench.requested.push(action); }"
    )
    asked = []
    page.on("dialog", lambda box: (asked.append(box.message), box.accept()))
    page.get_by_role("button", name="Stop", exact=True).click()
    assert asked == ["End the run of this bench?"]
    assert page.evaluate("() => hilBench.requested") == ["stop"]


def test_a_late_loop_is_coloured(page):
    expect(page.locator("#clock")).not_to_have_text("–")
    health = (
        "(p99) => { hilBench.model.health = { lateness: { p99_us: p99 }, overruns: 0, ticks: 1 } }"
    )
    page.evaluate("() => hilBench.link.takers.set('health', [])")
    page.evaluate(health, 128_000)
    expect(page.locator("#brief .bad")).to_have_text("late p99 128.0 ms")
    page.evaluate(health, 90)
    expect(page.locator("#brief .bad")).to_have_count(0)
