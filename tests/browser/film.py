"""The film of the panel in README.md: ``python tests/browser/film.py docs/images``.

A position controller moves the piston; a click breaks the wire of its sensor, the controller sees
that and closes the valve. Bench time passes only between two pictures, so the film is as smooth on
a slow machine as on a fast one. Needs ``pip install -e '.[browser]'`` and Debian's chromium.
"""

import contextlib
import os
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

sys.path.insert(0, str(Path(__file__).parents[1]))

from support.live_bench import SECRET, LiveBench, panel

from hil_bench import Faults, VirtualBench, load_config

FRAME = 0.08
"""Bench time between two pictures [s]; they are shown for as long."""

LENGTH, BREAKS = 4.0, 2.0
"""Of the film, and when the wire breaks in it [s]."""

LEAD = 0.6
SIZE = {"width": 1080, "height": 900}
FILM_WIDTH, COLOURS = 720, 64


CONTROLLER = """
from hil_bench.abilities.controllers.python.examples import ControllerSettings, position_control

def control(rig):
    return position_control(rig, ControllerSettings(target_mm=0.15, speed_mm_s=0.06))
"""


class Course:
    """The bench with its controller, moved on in this thread."""

    def __init__(self, folder):
        (folder / "film_control.py").write_text(CONTROLLER)
        call = f"{folder / 'film_control.py'}:control"
        tables = {"controllers": {"axis": {"kind": "python", "call": call}}}
        config = load_config(tables=tables)
        self.bench = VirtualBench(config, recorded_time=0.01, logged_frames=0)

    def advance(self, seconds):
        end = self.bench.now() + seconds
        while self.bench.now() < end - 1e-9:
            self.bench.run(0.002)


def show(page, course, seconds):
    """Let time pass, and wait until the page has drawn it."""
    course.advance(seconds)
    for _ in range(200):
        if page.evaluate("() => hilBench.model.time") >= course.bench.now() - 0.004:
            break
        course.advance(0.001)  # the feed looks for clients and commands in ticks
        page.wait_for_timeout(10)
    for _ in range(2):
        page.evaluate("() => new Promise(requestAnimationFrame)")


def shoot(page, course, folder):
    """Take the picture of each moment."""
    pictures = []
    count = round(LENGTH / FRAME)
    broken = round(BREAKS / FRAME)
    for number in range(count):
        if number == broken:
            pictures += [pictures[-1]] * 4
            click(page, course)
        show(page, course, FRAME)
        path = folder / f"{number:03}.png"
        page.screenshot(path=path)
        pictures.append(path)
    return pictures + [pictures[-1]] * 12


def click(page, course):
    """Break the wire; the command acts in a tick, so time has to pass for it."""
    page.get_by_role("button", name="Break wire: position").click()
    while not course.bench.bench.part(Faults).active:
        course.advance(0.001)
        page.wait_for_timeout(5)


def write(pictures, target):
    """Write the film as an animated PNG."""
    height = round(SIZE["height"] * FILM_WIDTH / SIZE["width"])
    images = [Image.open(path).convert("RGB").resize((FILM_WIDTH, height)) for path in pictures]
    palette = images[-1].quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE)
    frames = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    frames[0].save(
        target / "broken_sensor.png",
        save_all=True,
        append_images=frames[1:],
        duration=round(FRAME * 1000),
        loop=0,
        optimize=True,
    )


def main():
    target = Path(sys.argv[1])
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="hil-")))
        os.environ["XDG_RUNTIME_DIR"] = str(folder)
        course = Course(folder)
        live = LiveBench(bench=course.bench)
        stack.callback(live.close)
        port = stack.enter_context(panel())
        playwright = stack.enter_context(sync_playwright())
        browser = playwright.chromium.launch(
            executable_path="/usr/bin/chromium", args=["--no-sandbox"]
        )
        page = browser.new_page(viewport=SIZE, color_scheme="dark")
        page.goto(f"http://127.0.0.1:{port}/#{SECRET}")
        show(page, course, LEAD)
        pictures = shoot(page, course, folder)
        write(pictures, target)
        browser.close()


if __name__ == "__main__":
    main()
