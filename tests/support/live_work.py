"""Work that is no running bench, with its feed in this process, for tests of the panel."""

import contextlib
import threading

from hil_bench.abilities.common.shared_ring import SharedRing
from hil_bench.abilities.live.places import Place
from hil_bench.abilities.live.server import CAPACITY, MOST_COMMANDS, FeedPlan, FeedProcess
from hil_bench.abilities.live.view import WorkFeed

CHANNELS = [["axis1.position", "m"], ["axis1.P_A", "Pa"], ["axis1.P_A_twin", "Pa"], ["step", "-"]]


@contextlib.contextmanager
def live_work(verb="commission", channels=CHANNELS, again=()):
    """Yield the feed, and an event that is set when somebody asks for the end."""
    place, stopped = Place(verb), threading.Event()
    hello = {
        "name": verb,
        "pid": 1,
        "program": "hil-bench",
        "bench": f"{verb} plan.toml",
        "channels": channels,
        "nodes": [],
        **{name: {} for name in ("devices", "machines", "axes", "fault_targets")},
        "work": {"verb": verb, "title": "plan.toml on can0", "again": list(again)},
    }
    plan = FeedPlan(hello, 1 + len(channels), SharedRing(CAPACITY), SharedRing(MOST_COMMANDS))
    try:
        with WorkFeed(FeedProcess(place.listener, plan), plan, stopped.set) as feed:
            yield feed, stopped
    finally:
        place.release()
