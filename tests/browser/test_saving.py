"""What the scope saves: a picture, rows as CSV and MF4, and recordings by the bench."""

import csv
import re

import numpy as np
import pytest

from hil_bench.abilities.recording.reading import read_recording

pytestmark = pytest.mark.browser
expect = pytest.importorskip("playwright.sync_api").expect


@pytest.fixture
def scope(page):
    page.locator("#tab-scope").click()
    scope = page.locator("#view-scope")
    expect(scope.locator(".legend-value").first).to_have_text("0.00")
    return scope


def save(page, scope, name, path):
    with page.expect_download() as download:
        scope.get_by_role("button", name=name, exact=True).click()
    download.value.save_as(path)
    return path


def test_csv_and_mf4_hold_the_rows_that_are_shown(page, scope, tmp_path):
    scope.get_by_label("axis1.speed").check()
    scope.get_by_label("time shown").select_option("0.5")
    expect(page.locator("#clock")).to_have_text(re.compile(r"[1-9]\.\d\d s"))
    scope.get_by_role("button", name="Pause").click()
    table = read_recording(save(page, scope, "MF4", tmp_path / "scope.mf4"))
    with save(page, scope, "CSV", tmp_path / "scope.csv").open() as file:
        head, *rows = csv.reader(file)
    assert [name.partition(" [")[0] for name in head] == list(table.dtype.names)
    assert "axis1.speed [mm/s]" in head
    assert len(rows) == len(table) > 0
    np.testing.assert_allclose([float(row[0]) for row in rows], table["time"], atol=1e-6)
    column = head.index("axis1.P_A [bar]")
    shown = [1e5 * float(row[column]) for row in rows]
    np.testing.assert_allclose(shown, table["axis1.P_A"], rtol=1e-6)
    # At rest both chambers share the supply of 100 bar (Table I); a page has single precision.
    assert table["axis1.P_A"] + table["axis1.P_B"] == pytest.approx(100e5, rel=1e-6)


def test_the_picture_is_a_png(page, scope, tmp_path):
    content = save(page, scope, "PNG", tmp_path / "scope.png").read_bytes()
    assert content.startswith(b"\x89PNG\r\n\x1a\n")


def test_the_bench_records_from_the_page_and_the_key(page, scope, tmp_path):
    scope.get_by_role("button", name="Record", exact=True).click()
    expect(page.locator("#brief")).to_contain_text("records since")
    page.keyboard.press("2")
    page.keyboard.press("r")
    said = scope.get_by_role("status").filter(has_text="rows")
    expect(said).to_contain_text("frames")
    (path,) = tmp_path.glob("recording-*.mf4")
    assert f"{path}: {len(read_recording(path))} rows" in said.inner_text()
    expect(scope.get_by_role("button", name="Record", exact=True)).to_be_visible()
