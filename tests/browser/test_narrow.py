"""The drawing of the machine on a telephone: text that can be read, and nothing over anything."""

from itertools import combinations

import pytest

pytest.importorskip("playwright.sync_api")

pytestmark = pytest.mark.browser

LONGEST = {
    "sensor: 0.00 mm": "sensor: -123.45 mm",
    "0.00 mm": "-123.45 mm",
    "0.0 mm/s": "-123.4 mm/s",
    "spool 0.0 %": "spool -100.0 %",
    "set-point 0.0 %": "set-point -100.0 %",
    "valve INIT": "valve FAULT_DISABLED",
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
    for words in ("valve INIT", "sensor: 0.00 mm"):
        page.locator(".drawing").get_by_text(words).wait_for()
    found = page.evaluate(MEASURE, LONGEST)
    texts, whole = found["texts"], found["whole"]

    assert {"-123.45 mm", "spool -100.0 %", "valve FAULT_DISABLED"} <= {
        each["words"] for each in texts
    }
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


def test_a_page_that_is_turned_draws_anew(pages, port):
    page = pages.open(port, viewport={"width": 390, "height": 844})
    drawing = page.locator(".drawing svg")
    drawing.wait_for()
    narrow = drawing.get_attribute("viewBox")
    page.set_viewport_size({"width": 844, "height": 390})
    page.wait_for_function(
        "(before) => document.querySelector('.drawing svg').getAttribute('viewBox') !== before",
        arg=narrow,
    )
