"""The pictures of the page in the documents: ``python tests/browser/pictures.py FOLDER [NAME]``.

Each is the page as it is, in front of a command that runs: machines that move by their scenarios, a
layout, a telephone, a commissioning. `film.py` makes the film of README. Needs
``pip install -e '.[browser]'`` and Debian's chromium. Look at each picture before it is committed.
"""

import contextlib
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from PIL import Image
from playwright.sync_api import sync_playwright

ROOT = Path(__file__).parents[2]
COLOURS = 128


class Shot(NamedTuple):
    """One picture.

    Attributes:
        words: of the command that shows the page; ``panel`` joins it with these options.
        until: what must be true on the page.
        size: of the window.
        scheme: of its colours.
        options: of a ``hil-bench panel`` of its own; None for that of the command.
    """

    words: tuple[str, ...]
    until: str
    size: tuple[int, int] = (1400, 900)
    scheme: str = "light"
    options: tuple[str, ...] | None = None


CRANE = ("run", "--scenario", "examples/machines/crane.scenario.toml")
SHOTS = {
    "panel-machine": Shot((*CRANE, "--panel"), "hilBench.model.time > 3.1"),
    "panel-phone": Shot((*CRANE, "--panel"), "hilBench.model.time > 3.1", (390, 844), "dark"),
    "panel-layout": Shot(
        ("run", "examples/two_axes.toml", "-i", "virtual", "-c", "pictures", "--realtime", "off"),
        "hilBench.model.time > 5",
        options=("--layout", "examples/two_axes.layout.toml"),
    ),
    "panel-commission": Shot(
        ("commission", "examples/commissioning.toml", "--virtual", "--panel"),
        "hilBench.model.state.work?.done >= 4 && hilBench.model.store.count > 2000",
        (1280, 900),
        "dark",
    ),
}


def address_of(process):
    """Return the address that a command prints."""
    for line in process.stdout or ():
        if found := re.search(r"http://\S+", line):
            return found[0]
    raise SystemExit("no address was printed")


@contextlib.contextmanager
def running(*words):
    """Yield a command of hil-bench that runs in a folder of its own, beside the examples."""
    command = [sys.executable, "-u", "-m", "hil_bench", *words]
    process = subprocess.Popen(  # noqa: S603 - this program
        command, cwd=os.environ["XDG_RUNTIME_DIR"], stdout=subprocess.PIPE, text=True
    )
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


def take(browser, shot, target):
    """Take a picture."""
    with contextlib.ExitStack() as stack:
        process = stack.enter_context(running(*shot.words))
        if shot.options is not None:
            process = stack.enter_context(running("panel", "--port", "0", *shot.options))
        width, height = shot.size
        page = browser.new_page(
            viewport={"width": width, "height": height}, color_scheme=shot.scheme
        )
        page.goto(address_of(process))
        page.wait_for_function(f"() => {shot.until}", timeout=120_000)
        page.wait_for_timeout(200)  # a picture of the page, not of its opening
        page.screenshot(path=target)
        page.close()
    Image.open(target).convert("RGB").quantize(COLOURS).save(target, optimize=True)


def main():
    folder, names = Path(sys.argv[1]), sys.argv[2:] or list(SHOTS)
    with tempfile.TemporaryDirectory(prefix="hil-") as runtime, sync_playwright() as playwright:
        os.environ["XDG_RUNTIME_DIR"] = runtime
        (Path(runtime) / "examples").symlink_to(ROOT / "examples")
        browser = playwright.chromium.launch(
            executable_path="/usr/bin/chromium", args=["--no-sandbox"]
        )
        for name in names:
            take(browser, SHOTS[name], (folder / f"{name}.png").resolve())
        browser.close()


if __name__ == "__main__":
    main()
