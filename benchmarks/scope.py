"""Benchmark of the scope: pictures a second, processors, memory: ``python benchmarks/scope.py``.

A bench of two axes runs in real time with a panel. A page in chromium (by playwright) shows twelve
curves in the scope, with the markers of frames on; in turns, the same page shows another view.
Memory is that of the page's script, garbage left out, and of the processes, before and after.
"""

import argparse
import contextlib
import os
import tempfile
import time
from typing import Any

import occasion
from panel import BENCH, COUNT_FRAMES, Stand, chromium, open_page, page_seconds, script_memory

CURVES = 12
_WATCHED = "scope of 12 curves", "no plots"

MARK_TIMES = """async () => {
  const { view } = hilBench.views.find(({ id }) => id === 'scope');
  const begin = performance.now();
  for (const form of ['svg', 'png']) {
    const { drawPicture, pngFile, svgFile } = await import('/picture.js');
    const picture = drawPicture(view.plots, { title: 'benchmark', foot: [] });
    await (form === 'svg' ? svgFile(picture) : pngFile(picture));
  }
  return performance.now() - begin;
}"""


def main() -> None:
    """Run it all and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=10.0, help="of a turn")
    parser.add_argument("--realtime", default="off", help="as of hil-bench run")
    options = occasion.arguments(parser, rounds=1, seconds=1.0)
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="hil-"))
        os.environ["XDG_RUNTIME_DIR"] = folder
        stand = Stand(stack, BENCH, options.realtime)
        time.sleep(2.0)
        page = open_page(stack.enter_context(chromium()), stand)
        choose_curves(page)
        measure(stand, page, options)
        took = page.evaluate(MARK_TIMES)
        print(f"SVG and PNG of the scope together: {took:.0f} ms")
    print("load of the machine in the last minutes:", *map("{:.1f}".format, os.getloadavg()))


def choose_curves(page: Any) -> None:  # noqa: ANN401 - a page of playwright
    """Show twelve channels."""
    page.click("#tab-scope")
    boxes = page.locator(".channel input").all()
    for number, box in enumerate(boxes):
        box.set_checked(number < CURVES)
    page.wait_for_timeout(1000)


def measure(stand: Stand, page: Any, options: argparse.Namespace) -> None:  # noqa: ANN401 - likewise
    """Print a line for each view, all turns together, and the memory before and after."""
    watch = page.context.new_cdp_session(page)
    watch.send("Performance.enable", {"timeDomain": "threadTicks"})
    frames = dict.fromkeys(_WATCHED, 0.0)
    used: dict[str, dict[str, float]] = {name: {} for name in _WATCHED}
    before = script_memory(page), stand.memory()
    for _ in range(options.rounds):
        for name, tab in zip(_WATCHED, ("#tab-scope", "#tab-devices"), strict=True):
            page.click(tab)
            page.wait_for_timeout(500)
            begin = {**stand.seconds(), "page": page_seconds(watch)}
            frames[name] += page.evaluate(COUNT_FRAMES, options.seconds * 1000)
            end = {**stand.seconds(), "page": page_seconds(watch)}
            for part, value in end.items():
                used[name][part] = used[name].get(part, 0.0) + value - begin[part]
    whole = options.rounds * options.seconds
    print("| view | pictures a second | loop | feed | panel | thread of the page |")
    print("|---|---|---|---|---|---|")
    for name in _WATCHED:
        shares = " | ".join(f"{100 * each / whole:.1f} %" for each in used[name].values())
        print(f"| {name} | {frames[name] / options.rounds:.1f} | {shares} |")
    after = script_memory(page), stand.memory()
    print(f"script of the page, {2 * whole:g} s apart: {before[0]:.1f} and {after[0]:.1f} MB")
    for name, value in before[1].items():
        print(f"{name}: {value:.1f} and {after[1][name]:.1f} MB")


if __name__ == "__main__":
    main()
