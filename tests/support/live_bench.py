"""A bench with its feed in this process, and a panel in front of it, for tests of the panel."""

import asyncio
import contextlib
import shutil
import tempfile
import threading
from pathlib import Path

from hil_bench import VirtualBench, load_config
from hil_bench.abilities.common.shared_ring import SharedRing
from hil_bench.abilities.live.places import Place
from hil_bench.abilities.live.server import CAPACITY, MOST_COMMANDS, FeedPlan, FeedProcess
from hil_bench.abilities.live.session_feed import Feed, feed_parts
from hil_bench.abilities.live.view import hello_of
from hil_bench.abilities.panel.guard import Secret
from hil_bench.abilities.panel.server import PanelPlan, _serve, open_port

SECRET = "a secret of tests"  # noqa: S105 - it opens nothing else


class LiveBench:
    """A bench in virtual time that others can watch and command.

    Args:
        name: of the bench.
        bench: what runs; without it the built-in one.
        hello: what else it says of itself.
    """

    def __init__(self, name="bench", bench=None, hello=None):
        config = bench.config if bench else load_config()
        self.bench = bench or VirtualBench(config, recorded_time=0.01, logged_frames=0)
        session = self.bench.session
        self.session = session
        self.held = threading.Event()  # its time stands still
        self.place = Place(name)
        content = {**hello_of(name, config, session), **(hello or {})}
        plan = FeedPlan(
            content, 1 + len(session.channels), SharedRing(CAPACITY), SharedRing(MOST_COMMANDS)
        )
        process = FeedProcess(self.place.listener, plan)
        self.feed = Feed(
            session, process, plan, parts=feed_parts(session, config, is_real_time=False)
        )
        session.watch(ticks=lambda _now: self.feed.look())

    def close(self):
        self.feed.stop()
        self.place.release()
        self.bench.close()

    @contextlib.contextmanager
    def running(self):
        """Let its time pass in a thread, half as fast as the clock, while the block lasts."""
        over = threading.Event()

        def run():
            while not over.wait(0.02):
                if not self.held.is_set():
                    self.bench.run(0.01)

        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield self
        finally:
            over.set()
            thread.join()


@contextlib.contextmanager
def live_bench(name="bench", **options):
    """Yield a bench whose time passes."""
    bench = LiveBench(name, **options)
    try:
        with bench.running():
            yield bench
    finally:
        bench.close()


@contextlib.contextmanager
def runtime_folder(monkeypatch):
    """Yield a folder for sockets: a short one, as their paths may not be long."""
    folder = tempfile.mkdtemp(prefix="hil-")
    monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
    yield Path(folder)
    shutil.rmtree(folder)


def end_visits(loop):
    """End the search for benches, and with it the panel."""
    for task in asyncio.all_tasks(loop):
        if task.get_name() == "visits":
            task.cancel()


@contextlib.contextmanager
def panel(port=0, **plan):
    """Yield the port of a panel in a thread; it ends with the bench at the latest."""
    listener = open_port("127.0.0.1", port)
    begun, held = threading.Event(), {}

    async def serve():
        held["loop"] = asyncio.get_running_loop()
        begun.set()
        await _serve(PanelPlan(**plan), listener, Secret(SECRET))

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    begun.wait()
    try:
        yield listener.getsockname()[1]
    finally:
        with contextlib.suppress(RuntimeError):  # it has ended with the bench
            held["loop"].call_soon_threadsafe(end_visits, held["loop"])
        thread.join()
        listener.close()
