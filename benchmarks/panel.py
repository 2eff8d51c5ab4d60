"""Benchmark of a panel: its cost for the loop, its service: ``python benchmarks/panel.py``.

A bench of two axes (18 channels at 1 kHz) runs in real time with a panel in front of it. In turns,
nobody looks at it, three WebSocket clients do, of which one never reads, and three pages in
chromium (by playwright), of which one stands still; lateness comes from the loop's own histograms.
Then a page shows all channels in the scope.

``--memory-minutes 60`` does something else: a bench of one axis runs with one page on the scope,
which draws five pictures a second to leave the machine to others, and each minute has its line of
memory.
"""

import argparse
import contextlib
import json
import os
import re
import select
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect as open_socket

import occasion
from hil_bench.abilities.live.client import connect

ROOT = Path(__file__).parents[1]
BENCH = ROOT / "examples" / "two_axes.toml"
ONE_AXIS = ROOT / "examples" / "one_axis.toml"
TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")
SETTLING_MS = 3000

_PERCENTILES = (50, 99, 99.9)


class Client:
    """A browser without a page: it reads and counts, or it never reads."""

    def __init__(self, address: str, *, reads: bool) -> None:
        self.bytes = 0
        self._reads = reads
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(address,), daemon=True)
        self._thread.start()

    def _run(self, address: str) -> None:
        place, _, token = address.removeprefix("http://").partition("/#")
        with (
            contextlib.suppress(ConnectionClosed),
            open_socket(
                f"ws://{place}/feed", origin=f"http://{place}", compression=None, max_queue=4
            ) as socket,
        ):
            socket.send(json.dumps({"token": token}))
            while self._reads and not self._over.is_set():
                with contextlib.suppress(TimeoutError):
                    self.bytes += len(socket.recv(timeout=0.5))
            self._over.wait()

    def close(self) -> None:
        """Go."""
        self._over.set()
        self._thread.join()


class Stand:
    """The processes of a run, and what they have used so far."""

    def __init__(self, stack: contextlib.ExitStack, bench: Path, realtime: str) -> None:
        words = ("-i", "virtual", "-c", "bench", "--realtime", realtime)
        self.run = _start(stack, "run", str(bench), *words)
        self.panel = _start(stack, "panel", "--port", "0")
        line = self.panel.stdout.readline()
        self.address = re.search(rb"http\S+", line)[0].decode()

    def histogram(self) -> dict[float, int]:
        """Return the count of each bin of lateness, by its upper edge [us]."""
        with connect(timeout=10.0) as client:
            return dict(client.request("histograms")["lateness"])

    def seconds(self) -> dict[str, float]:
        """Return the processor time of loop, feed and panel [s]."""
        return {
            "loop": _seconds(self.run.pid),
            "feed": sum(map(_seconds, self._feeds())),
            "panel": _seconds(self.panel.pid),
        }

    def memory(self) -> dict[str, float]:
        """Return the resident memory of loop, feed and panel [MB]."""
        return {
            "loop": _resident(self.run.pid),
            "feed": sum(map(_resident, self._feeds())),
            "panel": _resident(self.panel.pid),
        }

    def _feeds(self) -> list[int]:
        return [pid for pid in _children(self.run.pid) if "multiprocessing" in _words(pid)]


def main() -> None:
    """Run it all and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=10.0, help="of a turn")
    parser.add_argument("--browser-seconds", type=float, default=30.0)
    parser.add_argument("--clicks", type=int, default=20, help="how many faults to click")
    parser.add_argument("--paints", type=int, default=5, help="how often to open the page")
    parser.add_argument("--realtime", default="off", help="as of hil-bench run")
    parser.add_argument("--memory-minutes", type=int, help="watch memory, and nothing else")
    options = occasion.arguments(
        parser, rounds=1, seconds=0.2, browser_seconds=0.5, clicks=1, paints=1
    )
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="hil-"))
        os.environ["XDG_RUNTIME_DIR"] = folder
        if options.memory_minutes:
            stand = Stand(stack, ONE_AXIS, options.realtime)
            watch_memory(stand, options.memory_minutes)
            return
        stand = Stand(stack, BENCH, options.realtime)
        time.sleep(2.0)
        with chromium() as browser:
            compare_loop(stand, options, browser)
            look_by_browser(stand, options, browser)
        print("load of the machine in the last minutes:", *map("{:.1f}".format, os.getloadavg()))


@contextlib.contextmanager
def chromium() -> Iterator[Any]:
    """Yield Debian's browser."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - the rest runs without it

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path="/usr/bin/chromium", args=["--no-sandbox"]
        )
        yield browser
        browser.close()


def compare_loop(stand: Stand, options: argparse.Namespace, browser: Any) -> None:  # noqa: ANN401
    """Print lateness without clients and with three, and what a client costs."""
    names = "nobody", "three clients", "three pages"
    counts: dict[str, dict[float, int]] = {name: {} for name in names}
    used: dict[str, dict[str, float]] = {name: {} for name in names}
    received = 0
    for _ in range(options.rounds):
        _turn(stand, options.seconds, counts["nobody"], used["nobody"])
        clients = [Client(stand.address, reads=number < 2) for number in range(3)]
        _turn(stand, options.seconds, counts["three clients"], used["three clients"])
        received += sum(client.bytes for client in clients)
        for client in clients:
            client.close()
        pages = [open_page(browser, stand) for _ in range(3)]
        stalled = pages[0].context.new_cdp_session(pages[0])
        stalled.send("Debugger.enable")
        stalled.send("Debugger.pause")  # its script goes no further
        _turn(stand, options.seconds, counts["three pages"], used["three pages"])
        stalled.send("Debugger.disable")
        for page in pages:
            page.close()
    print("| clients | ticks | p50 [us] | p99 | p99.9 | loop | feed | panel |")
    print("|---|---|---|---|---|---|---|---|")
    whole = options.rounds * options.seconds
    for name, found in counts.items():
        times = " | ".join(f"{_percentile(found, each):.0f}" for each in _PERCENTILES)
        shares = " | ".join(f"{100 * each / whole:.1f} %" for each in used[name].values())
        print(f"| {name} | {sum(found.values())} | {times} | {shares} |")
    print(f"bytes a second to a client that reads: {received / 2 / whole:.0f}")


def open_page(browser: Any, stand: Stand) -> Any:  # noqa: ANN401 - a browser and a page of playwright
    """Return a page that shows the bench."""
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.goto(stand.address)
    page.wait_for_selector("#clock:not(:text('–'))")
    return page


def look_by_browser(stand: Stand, options: argparse.Namespace, browser: Any) -> None:  # noqa: ANN401
    """Print what a browser sees."""
    seconds = options.browser_seconds
    paints = []
    for _ in range(options.paints):
        page = open_page(browser, stand)
        paints.append(page.evaluate(FIRST_PAINT))
        page.close()
    page = open_page(browser, stand)
    print(f"shipped: {page.evaluate(SHIPPED)}")
    page.wait_for_timeout(0 if options.brief else SETTLING_MS)
    frames = page.evaluate(COUNT_FRAMES, seconds * 1000)
    print(f"pictures a second of the machine, its plots beside it: {frames:.1f}")
    page.click("#tab-scope")
    for box in page.locator(".channel input").all():
        box.check()
    page.wait_for_timeout(0 if options.brief else SETTLING_MS)
    watch = page.context.new_cdp_session(page)
    watch.send("Performance.enable", {"timeDomain": "threadTicks"})
    before, used = (script_memory(page), _resident(stand.panel.pid)), page_seconds(watch)
    frames = page.evaluate(COUNT_FRAMES, seconds * 1000)
    used = page_seconds(watch) - used
    after = script_memory(page), _resident(stand.panel.pid)
    clicks = [page.evaluate(CLICK) * 1e3 for _ in range(options.clicks)]
    page.close()
    shown = ", ".join(f"{paint:.0f}" for paint in sorted(paints))
    print(f"first contentful paint [ms]: {shown}")
    print(
        f"pictures a second, 18 channels at 1 kHz: {frames:.1f}, "
        f"{1e3 * used / (frames * seconds):.1f} ms of the page's thread each"
    )
    print(
        f"click to the fault's first tick, at most: median {statistics.median(clicks):.1f} ms, "
        f"largest {max(clicks):.1f} ms of {options.clicks}"
    )
    (page_before, panel_before), (page_after, panel_after) = before, after
    print(f"memory over {seconds:g} s: page {page_before:.1f} to {page_after:.1f} MB,", end=" ")
    print(f"panel {panel_before:.1f} to {panel_after:.1f} MB")


def watch_memory(stand: Stand, minutes: int) -> None:
    """Print each minute how much memory the page and the processes use."""
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.add_init_script(SLOW_PICTURES)
        page.goto(stand.address)
        page.wait_for_selector("#clock:not(:text('–'))")
        page.click("#tab-scope")
        for box in page.locator(".channel input").all():
            box.check()
        page.evaluate("() => hilBench.link.request('want', { frames: true })")
        print("| minute | rows held | script of the page [MB] | page [MB] | loop | feed | panel |")
        print("|---|---|---|---|---|---|---|")
        for minute in range(minutes + 1):
            rows = page.evaluate("() => hilBench.model.store.count")
            script, whole = script_memory(page), _renderer_memory(page)
            rest = " | ".join(f"{each:.1f}" for each in stand.memory().values())
            print(f"| {minute} | {rows} | {script:.2f} | {whole:.1f} | {rest} |", flush=True)
            if minute < minutes:
                page.wait_for_timeout(60_000)


SLOW_PICTURES = """window.requestAnimationFrame = (draw) =>
  setTimeout(() => draw(performance.now()), 200);"""

SHIPPED = """() => {
  const sizes = {};
  for (const { name, decodedBodySize } of performance.getEntriesByType("resource")) {
    const kind = name.includes("/vendor/") ? "vendored" : name.split(".").pop();
    sizes[kind] = (sizes[kind] ?? 0) + decodedBodySize;
  }
  const text = ([kind, size]) => `${kind} ${(size / 1e3).toFixed(1)} kB`;
  return Object.entries(sizes).map(text).join(", ");
}"""

FIRST_PAINT = "() => performance.getEntriesByName('first-contentful-paint')[0].startTime"

COUNT_FRAMES = """async (length) => {
  const begin = performance.now();
  let count = 0;
  while (performance.now() - begin < length) {
    await new Promise(requestAnimationFrame);
    count += 1;
  }
  return (1000 * count) / (performance.now() - begin);
}"""

CLICK = """async () => {
  const { link, model } = hilBench;
  let offset = Infinity;
  const watch = ({ rows }) => {
    offset = Math.min(offset, performance.now() / 1e3 - rows.at(-1)[0]);
  };
  link.on("rows", watch);
  await new Promise((done) => setTimeout(done, 1000 + 200 * Math.random()));
  const click = performance.now() / 1e3;
  const begun = new Promise((done) => link.on("command", done));
  await link.request("fault", { kind: "freeze", target: "feed_position", keys: {} });
  const { time } = await begun;
  await link.request("clear_fault", {});
  link.takers.set("rows", link.takers.get("rows").filter((each) => each !== watch));
  link.takers.set("command", link.takers.get("command").slice(0, 1));
  return time + offset - click;
}"""


def _start(stack: contextlib.ExitStack, *words: str) -> "subprocess.Popen[bytes]":
    command = [sys.executable, "-m", "hil_bench", *words]
    process = subprocess.Popen(  # noqa: S603 - this program
        command, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL
    )
    stack.callback(process.wait)
    stack.callback(process.terminate)
    if not select.select([process.stdout], [], [], 60.0)[0]:
        raise TimeoutError(f"{words[0]}: says nothing")
    return process


def _turn(stand: Stand, seconds: float, found: dict[float, int], used: dict[str, float]) -> None:
    """Let a turn pass; add its lateness and processor time to what was found before."""
    time.sleep(1.0)
    counts, begin = stand.histogram(), stand.seconds()
    time.sleep(seconds)
    for edge, count in stand.histogram().items():
        found[edge] = found.get(edge, 0) + count - counts.get(edge, 0)
    for name, value in stand.seconds().items():
        used[name] = used.get(name, 0.0) + value - begin[name]


def _percentile(counts: dict[float, int], percent: float) -> float:
    rank, seen = sum(counts.values()) * percent / 100, 0
    for edge in sorted(counts):
        seen += counts[edge]
        if seen >= rank:
            return edge
    raise AssertionError("no ticks")


def script_memory(page: Any) -> float:  # noqa: ANN401 - a page of playwright
    """Return the memory that the page's script uses [MB], its garbage left out where possible."""
    session = page.context.new_cdp_session(page)
    session.send("HeapProfiler.collectGarbage")
    return session.send("Runtime.getHeapUsage")["usedSize"] / 1e6


def _renderer_memory(page: Any) -> float:  # noqa: ANN401 - a page of playwright
    """Return the resident memory of the largest process that draws pages [MB]."""
    session = page.context.browser.new_browser_cdp_session()
    processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
    return max(_resident(each["id"]) for each in processes if each["type"] == "renderer")


def page_seconds(session: Any) -> float:  # noqa: ANN401 - a session of playwright
    """Return the processor time of the page's main thread [s]."""
    metrics = session.send("Performance.getMetrics")["metrics"]
    return next(each["value"] for each in metrics if each["name"] == "TaskDuration")


def _seconds(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_A_SECOND


def _resident(pid: int) -> float:
    text = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    return int(re.search(r"VmRSS:\s+(\d+)", text)[1]) / 1e3


def _children(pid: int) -> set[int]:
    found: set[int] = set()
    for task in Path(f"/proc/{pid}/task").iterdir():
        with contextlib.suppress(
            FileNotFoundError, ProcessLookupError
        ):  # a thread that has just ended
            found.update(map(int, (task / "children").read_text(encoding="utf-8").split()))
    return found


def _words(pid: int) -> str:
    return Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8")


if __name__ == "__main__":
    main()
