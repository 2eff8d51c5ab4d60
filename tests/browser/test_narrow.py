"""The drawing of the machine on a telephone: text that can be read, and nothing over anything."""

from itertools import combinations

import pytest
from support.live_bench import live_bench

from hil_bench.cli import main

pytest.importorskip("playwright.sync_api")

pytestmark = pytest.mark.browser

LONGEST = {
    "0.00 mm": "-123.45 mm",
    "0.0 mm/s": "-123.4 mm/s",
    "A 51.4 bar": "A 321.4 bar",
    "spool 0.0 %": "spool -100.0 %",
    "set 0.0 %": "set -100.0 %",
    "INIT": "FAULT_DISABLED",
}

MEASURE = """(longest) => {
  const drawing = document.querySelector(".drawing svg");
  const scale = drawing.getScreenCTM().a;
  const texts = [...drawing.querySelectorAll("text")].filter((each) => each.textContent);
  for (const each of texts) each.textContent = longest[each.textContent] ?? each.textContent;
  return {
    whole: drawing.getBoundingClientRect().toJSON(),
    texts: texts.map((each) => ({
      words: each.textContent,
      size: parseFloat(getComputedStyle(each).fontSize) * scale,
      ...each.getBoundingClientRect().toJSON(),
    })),
  };
}"""


@pytest.mark.parametrize("width", [360, 390, 480])
def test_the_text_of_the_drawing_can_be_read(pages, port, width):
    page = pages.open(port, viewport={"width": width, "height": 844})
    for words in ("INIT", "0.00 mm"):
        page.locator(".drawing").get_by_text(words).wait_for()
    found = page.evaluate(MEASURE, LONGEST)
    texts, whole = found["texts"], found["whole"]

    assert {"-123.45 mm", "spool -100.0 %", "FAULT_DISABLED"} <= {each["words"] for each in texts}
    assert min(each["size"] for each in texts) >= 11.0
    assert all(whole["left"] <= each["left"] and each["right"] <= whole["right"] for each in texts)
    over = [
        (one["words"], other["words"])
        for one, other in combinations(texts, 2)
        if one["left"] < other["right"]
        and other["left"] < one["right"]
        and one["top"] + 4 < other["bottom"]  # a line's box is higher than its letters
        and other["top"] + 4 < one["bottom"]
    ]
    assert over == []


def test_the_header_of_a_telephone_has_room_for_the_time_beside_several_benches(pages, port):
    page = pages.open(port, viewport={"width": 390, "height": 844})
    page.get_by_text("INIT").first.wait_for()
    with live_bench("another-bench"):
        page.locator("#benches").wait_for()
        boxes = page.evaluate(
            "() => ['clock', 'benches', 'keys', 'stop'].map((each) =>"
            " document.getElementById(each).getBoundingClientRect().toJSON())"
        )
    assert max(each["right"] for each in boxes) <= 390
    for one, other in combinations(boxes, 2):
        apart = one["right"] <= other["left"] or other["right"] <= one["left"]
        assert apart or one["bottom"] <= other["top"] or other["bottom"] <= one["top"]


def test_the_report_of_a_test_is_read_without_scrolling_aside(chromium, tmp_path):
    path = tmp_path / "close.scenario.toml"
    path.write_text(
        'title = "Close"\nduration_s = 0.02\n\n[[expect]]\nid = "REQ-PRESSURE-1"\n'
        'that = "always axis1.P_A < 250 bar and always axis1.P_B < 250 bar"\n'
    )
    assert main(["test", str(path), "--report", str(tmp_path / "r.html"), "-q"]) == 0
    page = chromium.new_context(viewport={"width": 400, "height": 844}).new_page()
    page.goto(f"file://{tmp_path}/r.html")
    boxes = page.locator(".scroll")
    fits = boxes.evaluate_all("found => found.map((each) => each.scrollWidth <= each.clientWidth)")
    assert fits == [True, True, True]
