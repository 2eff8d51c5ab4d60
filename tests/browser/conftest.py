"""A real browser in front of a panel: Debian's chromium, driven by playwright."""

import contextlib
import os
import shutil
from pathlib import Path

import pytest
from support.live_bench import SECRET, live_bench, panel, runtime_folder

ARTEFACTS = os.environ.get("HIL_BENCH_SCREENSHOTS")
"""Where pictures go; without it nobody keeps any."""

PATIENCE = 30_000
"""Longest wait for the page to show something [ms]: on a busy machine."""


@pytest.fixture(scope="session")
def chromium():
    api = pytest.importorskip("playwright.sync_api")
    path = shutil.which("chromium")
    if path is None:
        pytest.skip("needs chromium: apt-get install chromium")
    api.expect.set_options(timeout=PATIENCE)
    with api.sync_playwright() as playwright:
        # In a container there is no further sandbox; all pages are our own.
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def folder(monkeypatch):
    with runtime_folder(monkeypatch) as folder:
        yield folder


@pytest.fixture
def bench(folder):  # noqa: ARG001 - its sockets are there
    with live_bench() as bench:
        yield bench


@pytest.fixture
def port(bench, tmp_path):  # noqa: ARG001 - what it shows
    with panel(folder=tmp_path) as port:
        yield port


class Pages:
    """Opens pages, and keeps what they complain of."""

    def __init__(self, browser):
        self._browser = browser
        self.complaints = []

    def open(self, port, secret=SECRET, *, clocked=False, **options):
        context = self._browser.new_context(
            **{"viewport": {"width": 1280, "height": 900}, **options}
        )
        context.set_default_timeout(PATIENCE)
        page = context.new_page()
        if clocked:
            page.clock.install()
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("console", self._note)
        page.goto(f"http://127.0.0.1:{port}/#{secret}")
        return page

    def _note(self, message):
        # A connection that fails is no fault of the page: it says so, and tries again.
        if message.type in {"error", "warning"} and "WebSocket" not in message.text:
            self.complaints.append(message.text)


@pytest.fixture
def pages(chromium):
    pages = Pages(chromium)
    yield pages
    for context in chromium.contexts:
        context.close()
    assert pages.complaints == []


@pytest.fixture
def page(pages, port):
    return pages.open(port)


@pytest.fixture
def keep():
    """Keep a picture of a page, for people to look at."""

    def keep(page, name):
        if ARTEFACTS:
            with contextlib.suppress(FileExistsError):
                Path(ARTEFACTS).mkdir(parents=True)
            page.screenshot(path=Path(ARTEFACTS) / f"{name}.png")

    return keep
