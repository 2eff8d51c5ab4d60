"""The page as people use it: start, plot, pause, cursor, break, record, lose the bench."""

import re

import pytest
from support.axe import serious_problems
from support.live_bench import live_bench, panel

from hil_bench.abilities.faults.faults import Faults
from hil_bench.abilities.scenario.load import load_scenario

pytestmark = pytest.mark.browser
expect = pytest.importorskip("playwright.sync_api").expect

BLACK = """() => [...document.querySelectorAll("main section:not([hidden]) svg text")]
  .filter((each) => getComputedStyle(each).fill === "rgb(0, 0, 0)")
  .map((each) => each.textContent).filter(Boolean)"""
VIEWS = ("machine", "scope", "devices", "bus", "faults", "loop", "record")


def view(page, name):
    page.locator(f"#tab-{name}").click()
    return page.locator(f"#view-{name}")


def number_of(text):
    return float(re.search(r"-?\d+(\.\d+)?", text)[0])


def clock(page):
    return page.locator("#clock").inner_text()


def wait_for_rows(page):
    expect(page.locator("#clock")).to_have_text(re.compile(r"\d+\.\d\d s"))


def test_it_starts_and_the_machine_moves(page, bench, keep):
    wait_for_rows(page)
    expect(page.locator("#banner")).to_be_hidden()
    text = page.locator(".drawing text.huge")
    expect(text).to_have_text("0.00 mm")
    bench.session.bench.axes[0].plant.influence("load", 40_000.0)
    # A load of 40 kN pushes the piston in: far more than the 0.05 mm that one sees.
    expect(text).not_to_have_text(re.compile(r"^-?0\.0\d mm"))
    assert number_of(text.text_content()) < -0.05
    expect(page.locator(".valve-state")).to_have_text("INIT")
    # Table I; on this bench nobody sees the pressure of the supply.
    expect(page.locator(".drawing")).to_contain_text("set to 100.0 bar")
    keep(page, "machine")


def test_the_scope_plots_pauses_and_measures(page, keep):
    scope = view(page, "scope")
    expect(scope.locator("canvas")).to_have_count(3)  # mm, bar, %
    expect(scope.locator(".legend-value").first).to_have_text("0.00")
    scope.get_by_role("button", name="Pause").click()
    frozen = scope.locator("canvas").first.evaluate("canvas => canvas.toDataURL()")
    before = clock(page)
    expect(page.locator("#clock")).not_to_have_text(before)  # time goes on, the picture does not
    assert scope.locator("canvas").first.evaluate("canvas => canvas.toDataURL()") == frozen
    scope.get_by_label("time of cursor A").fill("0.5")
    scope.get_by_label("time of cursor B").fill("0.75")
    scope.get_by_label("time of cursor B").press("Enter")
    expect(scope.get_by_text("B \u2212 A = 250.00 ms")).to_be_visible()
    row = scope.locator(".cursor-table tbody tr").first
    expect(row).to_contain_text("axis1.position")
    keep(page, "scope-cursors")
    page.keyboard.press("Escape")
    scope.get_by_role("button", name="Live").click()
    expect(scope.get_by_role("button", name="Pause")).to_be_visible()


def test_channels_are_found_by_their_names(page):
    scope = view(page, "scope")
    scope.get_by_label("search channels").fill("speed")
    expect(scope.locator(".channel:visible")).to_have_count(2)
    expect(scope.locator(".channel:visible").first).to_contain_text("mm/s")
    scope.get_by_label("axis1.speed").check()
    expect(scope.locator("canvas")).to_have_count(4)


def test_a_sensor_is_broken_by_a_click_and_mended(page, bench, keep):
    wait_for_rows(page)
    page.get_by_role("button", name="Break wire: position").click()
    sensor = page.locator(".sensors tr", has_text="position")
    expect(sensor).to_contain_text("no value")
    expect(page.locator(".active-faults")).to_contain_text("break_wire position")
    (fault,) = bench.session.bench.part(Faults).active
    assert (fault.kind, fault.target) == ("break_wire", "position")
    keep(page, "broken-sensor")
    devices = view(page, "devices")
    expect(devices).to_contain_text(re.compile(r"last EMCY 0x[0-9A-F]{4}"))
    keep(page, "devices")
    view(page, "machine").get_by_role("button", name="clear break_wire position").click()
    expect(sensor).to_contain_text("0.00 mm")
    expect(page.locator(".active-faults")).to_have_text("none")


def test_a_fault_of_any_kind_takes_its_keys(page, bench, keep):
    faults = view(page, "faults")
    faults.get_by_role("button", name="Offset").click()
    faults.get_by_label("target").select_option("position")
    faults.get_by_label("offset [mm]").fill("3")
    faults.get_by_role("button", name="Begin the fault").click()
    expect(faults.locator("tbody")).to_contain_text("offset position")
    keep(page, "faults")
    faults.get_by_role("button", name="Drop supply pressure").click()
    faults.get_by_label("pressure [bar]", exact=True).fill("-9999999")
    faults.get_by_role("button", name="Begin the fault").click()
    expect(faults.get_by_role("alert")).to_contain_text("pressure_bar")
    faults.get_by_label("axis1: load [kN]").fill("5")
    faults.get_by_label("axis1: load [kN]").press("Enter")
    expect(faults).to_contain_text("axis1.load is 5 kN")
    faults.get_by_role("button", name="Clear all faults").click()
    expect(faults.locator("tbody")).to_have_text("no fault")
    assert bench.session.bench.part(Faults).active == ()


def test_an_object_is_read_and_set(page, bench):
    devices = view(page, "devices")
    card = devices.locator("article", has_text="valve_408")
    card.get_by_text("Objects").click()
    card.get_by_label("search objects of valve").fill("0x1017")
    card.get_by_label("allow writing").check()
    card.get_by_label("new value of 0x1017.00").fill("500")
    card.get_by_role("button", name="set 0x1017.00").click()
    expect(card.locator("output:visible")).to_have_text("500 (0x1F4)")
    assert bench.session.nodes["valve"]["0x1017"] == 500


def test_the_bus_is_read_in_words(page, bench, keep):
    bus = view(page, "bus")
    bench.session.nodes["valve"]["0x1017"] = 50
    trace = bus.get_by_role("region", name="frames")
    expect(trace).to_contain_text("valve heartbeat")
    expect(trace).to_contain_text("PRE-OPERATIONAL")
    expect(bus.get_by_role("region", name="who sends what")).to_contain_text("0x701")
    expect(bus.get_by_role("region", name="who sends what")).to_contain_text("20.0")  # each 50 ms
    bus.get_by_label("filter frames").fill("nothing like this")
    expect(trace.locator("tbody tr")).to_have_count(0)
    bus.get_by_label("filter frames").fill("0x701")
    expect(trace.locator("tbody tr").first).to_be_visible()
    keep(page, "bus")


def test_the_bus_says_what_is_wrong(page, bench, keep):
    bus = view(page, "bus")
    for name in ("valve", "pressure_a"):
        bench.session.nodes[name]["0x1017"] = 50
    senders = bus.get_by_role("region", name="who sends what")
    for name in ("valve", "pressure_a"):  # ten beats of each show its period
        beats = re.compile(rf"{name} heartbeat\s*\d\d+\s*20\.0")
        expect(senders.get_by_role("row").filter(has_text=f"{name} heartbeat")).to_contain_text(
            beats
        )
    bench.session.bench.part(Faults).silence("valve")
    wrong = bus.get_by_role("region", name="what is wrong on the bus")
    expect(wrong).to_contain_text("heartbeat lost: valve: no heartbeat after")
    wrong.get_by_text("heartbeat lost").click()
    expect(wrong).to_contain_text("bus-off")
    expect(wrong).to_contain_text(re.compile(r"the times below count from \d+\.\d{3} s"))
    view(page, "loop")
    view(page, "bus")
    expect(wrong).not_to_contain_text("heartbeat lost")  # of frames before those that come now
    keep(page, "bus-findings")


def test_what_is_clicked_becomes_a_test(page, tmp_path, keep):
    wait_for_rows(page)
    record = view(page, "record")
    record.get_by_role("button", name="Start recording").click()
    faults = view(page, "faults")
    faults.get_by_role("button", name="Offset").click()
    faults.get_by_label("target").select_option("pressure_a")
    faults.get_by_label("offset [bar]").fill("80")
    faults.get_by_role("button", name="Begin the fault").click()
    expect(faults).to_contain_text("offset pressure_a has begun")
    faults.get_by_label("text of the mark").fill("<b>here</b>")
    faults.get_by_role("button", name="Mark this moment").click()
    record = view(page, "record")
    expect(record).to_contain_text("mark: <b>here</b>")
    record.get_by_label("channel").select_option("pressure_a.measured")
    record.get_by_label("limit").fill("100")
    record.get_by_role("button", name="use").click()
    record.get_by_role("button", name="Save and run").click()
    # At rest about 50 bar, with 80 bar more: not below 100 bar.
    expect(record.locator(".verdict")).to_have_text("failed", timeout=60_000)
    keep(page, "record")
    scenario = load_scenario(tmp_path / "recorded.scenario.toml")
    assert [(step.kind, step.target) for step in scenario.steps] == [("offset", "pressure_a")]


@pytest.mark.usefixtures("folder")
def test_the_bench_goes_and_comes_back(pages, keep):
    with panel() as port:
        page = pages.open(port)
        banner = page.locator("#banner")
        expect(banner).to_contain_text("no bench runs; start one with hil-bench run")
        keep(page, "no-bench")
        with live_bench():
            wait_for_rows(page)
            expect(banner).to_be_hidden()
        expect(banner).to_contain_text("bench bench has ended; the page goes on when it runs again")
        with live_bench():
            expect(banner).to_be_hidden()
            wait_for_rows(page)
    expect(banner).to_contain_text("the panel does not answer")
    with panel(port=port), live_bench():
        expect(banner).to_be_hidden()
        wait_for_rows(page)


@pytest.mark.usefixtures("folder")
def test_of_two_benches_one_is_chosen(pages):
    with live_bench("left"), live_bench("right"), panel() as port:
        page = pages.open(port)
        banner = page.locator("#banner")
        expect(banner).to_contain_text("2 benches run")
        banner.get_by_role("button", name="right").click()
        expect(page.locator("#bench-name")).to_have_text("right")
        wait_for_rows(page)


def test_a_wrong_secret_is_told_and_the_right_one_asked_for(pages, port):
    page = pages.open(port, "wrong")
    banner = page.locator("#banner")
    expect(banner).to_contain_text("the secret in the address is not this panel's")
    banner.get_by_label("password").fill("a secret of tests")
    banner.get_by_role("button", name="Enter").click()
    wait_for_rows(page)


@pytest.mark.usefixtures("folder")
def test_names_from_outside_are_never_markup(pages):
    bad = "<img src=x onerror=alert(1)>"
    hello = {
        "name": bad,
        "nodes": [bad],
        "devices": {bad: {"node_id": 1, "bus": 0, "kind": bad, "axis": "axis1", "eds": bad}},
        "axes": {bad: [{"name": bad, "unit": bad, "low": 0, "high": 1}]},
        "fault_targets": {"sensors": [bad], "valves": [], "supplies": [], "nodes": [bad]},
    }
    with live_bench() as plain:
        hello["channels"] = [[bad, bad]] * len(plain.session.channels)
    with live_bench(hello=hello), panel() as port:
        page = pages.open(port)
        wait_for_rows(page)
        for name in VIEWS:
            section = view(page, name)
            expect(section.locator("img")).to_have_count(0)
        expect(page.locator("#bench-name")).to_have_text(bad)
        expect(view(page, "devices")).to_contain_text(bad)


def test_everything_is_reached_by_keyboard(page):
    wait_for_rows(page)
    page.keyboard.press("5")
    expect(page.locator("#view-faults")).to_be_visible()
    page.keyboard.press("ArrowLeft")
    expect(page.locator("#view-bus")).to_be_visible()
    page.keyboard.press("1")
    page.get_by_role("button", name="Freeze: position").focus()
    page.keyboard.press("Enter")
    expect(page.locator(".active-faults")).to_contain_text("freeze position")


def test_nothing_is_wider_than_a_phone(pages, port, keep):
    phone = {"viewport": {"width": 360, "height": 740}, "is_mobile": True, "has_touch": True}
    page = pages.open(port, **phone)
    wait_for_rows(page)
    for name in VIEWS:
        expect(view(page, name)).to_be_visible()
        assert page.locator("html").evaluate("html => html.scrollWidth") <= 360, name
        keep(page, f"{name}-phone")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_serious_is_found_by_axe(pages, port, scheme, keep):
    page = pages.open(port, color_scheme=scheme, viewport={"width": 1024, "height": 768})
    wait_for_rows(page)
    for name in VIEWS:
        section = view(page, name)
        expect(section).to_be_visible()
        width = page.locator("html").evaluate("html => html.scrollWidth")
        assert width <= 1024, name
        keep(page, f"{name}-{scheme}-1024")
        assert serious_problems(page) == [], name
        assert page.evaluate(BLACK) == [], name  # axe does not look at the text of pictures
