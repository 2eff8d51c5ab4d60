"""A browser that reads too slowly loses its own picture, and only that."""

import asyncio
import json

import pytest

from hil_bench.abilities.panel.hub import MOST_UNREAD, MOST_WAITING, Viewer

LINE = b'{"type":"rows"}\n'


class Browser:
    """The other end: it takes a message whenever it is let."""

    def __init__(self):
        self.got = []
        self.is_free = asyncio.Event()
        self.is_free.set()

    async def send(self, data):
        await self.is_free.wait()
        self.got.append(data)


async def settle():
    for _ in range(5):
        await asyncio.sleep(0)


def played(course):
    async def play():
        browser = Browser()
        viewer = Viewer(browser.send)
        pump = asyncio.create_task(viewer.pump())
        await course(browser, viewer)
        pump.cancel()

    asyncio.run(play())


def test_what_waits_goes_in_one_message():
    async def course(browser, viewer):
        viewer.offer(LINE)
        viewer.tell(b"answer\n")
        await settle()
        assert browser.got == [LINE + b"answer\n"]

    played(course)


def test_a_stalled_browser_loses_pictures_and_no_answers():
    async def course(browser, viewer):
        browser.is_free.clear()
        bundle = LINE * 100
        for _ in range(2 * MOST_UNREAD // len(bundle)):
            viewer.offer(bundle)
            await settle()
        assert viewer.is_slow
        viewer.tell(b"answer\n")
        lost = viewer.lost
        # What fits is the first MiB, and the bundle with which it is full.
        assert lost == pytest.approx(MOST_UNREAD / len(LINE), abs=300)
        browser.is_free.set()
        await settle()
        text = b"".join(browser.got)
        assert text.endswith(b"answer\n")
        assert b'{"type":"missed","messages":%d}' % lost in text
        assert not viewer.is_slow
        viewer.offer(LINE)
        await settle()
        assert browser.got[-1] == LINE
        assert [json.loads(line) for line in browser.got[-1].splitlines()] == [{"type": "rows"}]

    played(course)


def test_what_a_browser_asks_while_it_is_stalled_counts_for_what_it_may_lose():
    """Answers fill its share as rows do; what is still unread counts until it is sent."""

    async def course(browser, viewer):
        browser.is_free.clear()
        viewer.tell(b"x" * MOST_UNREAD)
        viewer.offer(LINE)  # exactly full: this still goes
        assert viewer.lost == 0
        await settle()
        viewer.offer(LINE)
        assert viewer.lost == 1
        viewer.tell(b"answer\n")
        browser.is_free.set()
        await settle()
        assert viewer.lost == 0
        assert browser.got[1] == b'{"type":"missed","messages":1}\nanswer\n'

    played(course)


def test_a_browser_that_never_reads_is_given_up():
    async def course(browser, viewer):
        browser.is_free.clear()
        for _ in range(MOST_WAITING // 1000 + 1):
            viewer.tell(b"x" * 1000)
        assert viewer.over.is_set()

    played(course)
