"""The picture of a cylinder: bore, rod and stroke to one scale, at the slope of its load."""

import math
import re
import xml.etree.ElementTree as ET

import pytest

from hil_bench.bench.configuration import load_config

SIZES = {"bore_mm": 63, "rod_mm": 36, "stroke_mm": 500, "rated_flow_l_min": 60}
SHEET = {
    "rated_pressure_drop_bar": 5,
    "overlap_percent": 15,
    "frequency_90deg_hz": 40,
    "supply_pressure_bar": 210,
}


def page(**keys):
    axis = load_config(tables={"plant": {"axis1": SIZES | SHEET | keys}}).axes[0]
    return axis.kind.page(axis)


def numbers(text):
    return [float(each) for each in re.findall(r"-?\d+(?:\.\d+)?", text)]


class Drawing:
    """The elements of a picture, and the way from the page into the cylinder's own frame."""

    def __init__(self, svg):
        root = ET.fromstring(svg)  # noqa: S314 - our own
        self.whole = root
        _, _, self.width, self.height = numbers(root.get("viewBox", ""))
        self.body = root[0]
        self.x, self.y, self.turn, self.shift, _ = numbers(self.body.get("transform", ""))
        self.moving = next(each for each in self.body if each.tag == "g")

    def rect(self, name, number=0):
        """Return x, y, width and height of a rectangle."""
        found = [each for each in self.body.iter("rect") if each.get("class") == name][number]
        return [float(found.get(key, "")) for key in ("x", "y", "width", "height")]

    def on_page(self, x, y):
        """Return a point of the cylinder's frame on the page."""
        turn, x = math.radians(self.turn), x + self.shift
        cos, sin = math.cos(turn), math.sin(turn)
        return self.x + x * cos - y * sin, self.y + x * sin + y * cos


@pytest.mark.parametrize("slope", [0.0, 30.0, -50.0, -90.0, 90.0])
def test_a_cylinder_is_to_scale_and_fits(slope):
    """One scale [units/m] for stroke 500 mm, bore 63 mm and rod 36 mm, rounded to 0.1 units."""
    drawing = Drawing(page(load_mass_kg=100, load_slope_deg=slope).svg)
    *ends, begin, stroke = numbers(drawing.moving.get("data-x", ""))
    assert (ends, begin) == ([-0.25, 0.25], 0.0)
    scale = stroke / 0.5
    x, y, width, height = drawing.rect("barrel")
    piston, rod, mass = drawing.rect("steel"), drawing.rect("steel", 1), drawing.rect("mass")
    assert (height, rod[3]) == (
        pytest.approx(0.063 * scale, abs=0.051),
        pytest.approx(0.036 * scale, abs=0.051),
    )
    assert piston == [x, y, pytest.approx(width - stroke, abs=0.051), height]
    for each in (drawing.rect("barrel"), rod, mass):  # on one axis
        assert 2.0 * each[1] + each[3] == pytest.approx(0.0, abs=0.11)
    assert rod[0] == piston[0] + piston[2]
    assert rod[0] + rod[2] == mass[0] > x + width  # it leaves the barrel
    for number, name in enumerate(("P_B", "P_A")):
        assert drawing.rect("chamber", number)[:2] == [x, y]
        assert drawing.body.findall("rect")[number].get("data-fill") == f"{name} 0 2.1e+07"
    # Ticks where the piston's middle is at the ends of its stroke and between.
    ticks = [numbers(each.get("d", ""))[0] for each in drawing.body if each.get("class") == "scale"]
    middle = x + piston[2] / 2
    assert ticks == pytest.approx([middle, middle + stroke / 2, middle + stroke], abs=0.051)
    # Positive is uphill: the page turns to the left. Where it has extended it is still on it.
    assert drawing.turn == -slope
    for along in (0.0, mass[0] + mass[2] + stroke):
        for side in (y, -y):
            across, down = drawing.on_page(along, side)
            assert 0.0 <= across <= drawing.width == 440.0
            assert 0.0 <= down <= drawing.height


@pytest.mark.parametrize("slope", [0.0, 30.0, -50.0, 50.0])
def test_the_ports_are_on_the_barrel_and_apart(slope):
    drawing = Drawing(page(load_mass_kg=100, load_slope_deg=slope).svg)
    x, y, width, _ = drawing.rect("barrel")
    ports = {
        each.get("data-port"): (float(each.get("cx", "")), float(each.get("cy", "")))
        for each in drawing.whole.iter("circle")
    }
    # 4 units within the piston's rest at its end, 2 beyond the wall.
    along = {"A": x + 4.0, "B": x + width - 4.0}
    sides = {
        name: next(
            side
            for side in (-1.0, 1.0)
            if drawing.on_page(along[name], side * (2.0 - y)) == pytest.approx(point, abs=0.15)
        )
        for name, point in ports.items()
    }
    if abs(slope) < 45.0:
        assert sides == {"A": 1.0, "B": 1.0}  # below
    else:
        assert ports["A"][0] < ports["B"][0]  # no line runs over the other port
        assert sides["A"] == -sides["B"]


def test_arrows_show_weight_and_load():
    level = Drawing(page(load_mass_kg=100).svg)
    assert not level.moving.findall(".//path")
    steep = Drawing(page(load_mass_kg=100, load_slope_deg=30.0).svg)
    arrow = steep.moving.find("g")
    assert arrow is not None
    *place, turn = numbers(arrow.get("transform", ""))
    assert turn + steep.turn == 0.0  # down on the page
    x, _, width, _ = steep.rect("mass")
    assert place == [x + width / 2, 0.0]
    for force, to in ((1000, -1.0), (-1000, 1.0)):  # a positive load pushes the rod in
        drawing = Drawing(page(load_n=force).svg)
        (path,) = drawing.moving.findall("path")
        tail, _, tip, first, up, second, _, third, down = numbers(path.get("d", ""))
        assert (tip - tail) * to > 0.0
        assert (first - tip) * to == (third - tip) * to < 0.0
        assert second == tip
        assert up == -down


def test_a_second_rod_is_drawn_behind_its_piston():
    single, double = Drawing(page().svg), Drawing(page(second_rod_mm=36).svg)
    assert len(single.moving.findall("rect")) == 3
    x, y, width, height = double.rect("steel")
    stroke = numbers(double.moving.get("data-x", ""))[-1]
    barrel = double.rect("barrel")
    assert (x + width, width) == (barrel[0], pytest.approx(stroke, abs=0.051))
    assert 2.0 * y + height == pytest.approx(0.0, abs=0.11)
