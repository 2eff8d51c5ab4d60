"""`hil_bench.attach()`: a running bench from Python."""

import itertools
import math

import pytest
from support.feed_loop import FeedLoop, Wire

import hil_bench
from hil_bench import BusError, ConfigError, Faults, WaitTimeoutError
from hil_bench.abilities.live import attached
from hil_bench.abilities.live.client import FeedClient, only_one


@pytest.fixture
def loop(monkeypatch):
    loop = FeedLoop()
    monkeypatch.setattr(attached, "connect", loop.connect)
    return loop


def test_the_newest_values_come_by_name(loop):
    with hil_bench.attach() as bench:
        latest = bench.latest()
        channels = [channel.name for channel in loop.session.channels]
        assert list(latest) == ["time", *channels]
        # Table I of the paper has a supply of 100 bar; at rest both chambers share it.
        assert latest["axis1.P_A"] + latest["axis1.P_B"] == pytest.approx(100e5)
        loop.tick(500)
        assert bench.latest()["time"] == pytest.approx(loop.now * 1e-9, abs=0.1)


def test_a_value_that_is_none_is_nan(loop):
    loop.session.bench.part(Faults).break_wire("pressure_a")
    loop.tick(2)
    assert math.isnan(hil_bench.attach().latest()["pressure_a.measured"])


@pytest.mark.usefixtures("loop")
def test_rows_come_tick_by_tick():
    with hil_bench.attach() as bench:
        rows = list(itertools.islice(bench.rows(), 50))
    steps = {round((b["time"] - a["time"]) * 1e3) for a, b in itertools.pairwise(rows[1:])}
    assert steps == {1}


def test_a_fault_lasts_for_its_block(loop):
    bench = hil_bench.attach()
    for values, named in (((), {"amount": 2e6}), ((2e6,), {})):
        with bench.faults.offset("pressure_a", *values, **named):
            (fault,) = loop.session.bench.part(Faults).active
            assert (fault.kind, fault.target) == ("offset", "pressure_a")
    assert loop.session.bench.part(Faults).active == ()


def test_a_fault_that_has_ended_is_cleared_in_peace(loop):
    bench = hil_bench.attach()
    with bench.faults.freeze("pressure_a", duration=0.01):
        loop.tick(20)
    bench.faults.freeze("pressure_b")
    bench.faults.clear()
    assert loop.session.bench.part(Faults).active == ()


@pytest.mark.usefixtures("loop")
def test_an_unknown_verb_is_no_fault():
    with pytest.raises(AttributeError, match="no fault is called melt; there are freeze, offset"):
        hil_bench.attach().faults.melt("pressure_a")


def test_objects_are_read_and_set(loop):
    bench = hil_bench.attach()
    bench.nodes["valve"]["0x1017"] = 500
    assert bench.nodes["valve"]["0x1017"] == 500
    assert loop.session.nodes["valve"]["0x1017"] == 500
    with pytest.raises(ConfigError, match=r"nodes\.valve: 0x1017\.00 .*cannot hold 70000"):
        bench.nodes["valve"]["0x1017"] = 70000


def test_a_load_acts_on_the_plant(loop):
    bench = hil_bench.attach()
    bench.set_plant("axis1", "load", 5000.0)
    loop.tick(200)
    # A load pushes the piston back: P_A falls against P_B.
    latest = bench.latest()
    assert latest["axis1.P_A"] != pytest.approx(latest["axis1.P_B"], rel=0.01)
    with pytest.raises(ConfigError, match=r"axis1\.load = 1e\+99: give"):
        bench.set_plant("axis1", "load", 1e99)


def test_a_bench_that_ends_ends_the_rows(loop):
    rows = hil_bench.attach().rows()
    next(rows)
    for client in list(loop.server.clients):
        client.write(b'{"type":"end"}\n')
        client.close()
    assert len(list(rows)) < 1000


def test_a_bench_that_is_lost_says_so(loop):
    bench = hil_bench.attach()
    for client in list(loop.server.clients):
        client.close()
    with pytest.raises(BusError, match="bench bench: the connection is lost"):
        bench.latest()


def test_time_that_stands_still_is_a_time_out(loop):
    bench = hil_bench.attach(timeout=1.0)
    loop.tick = lambda: None
    with pytest.raises(WaitTimeoutError, match=r"no answer in 1 s; its time stands still"):
        bench.faults.freeze("pressure_a")


def test_another_version_is_refused(loop):
    wire = Wire(loop)
    wire.out = bytearray(b'{"type":"hello","version":2}\n')
    with pytest.raises(BusError, match="speaks version 2 of the feed, and this program version 1"):
        FeedClient("bench", wire)
    assert wire.is_closed


@pytest.mark.parametrize("line", [b"[1]\n", b"\xff\n", b"[" * 50000 + b"\n"])
def test_what_is_no_message_is_refused(loop, line):
    wire = Wire(loop)
    wire.out = bytearray(line)
    with pytest.raises(BusError, match="its message is not a JSON object"):
        FeedClient("bench", wire)


def test_one_bench_needs_no_name():
    assert only_one(["bench"]) == "bench"
    with pytest.raises(BusError, match="no bench runs; start one with hil-bench run"):
        only_one([])
    with pytest.raises(ConfigError, match="2 benches run; name one of a, b"):
        only_one(["a", "b"])


# The client's own side of a connection.


class Drip(Wire):
    """A bench that, once greeted, sends a byte a second of a message without an end."""

    def __init__(self, loop):
        super().__init__(loop)
        self.now, self.waits, self.is_dripping = 0.0, [], False

    def settimeout(self, timeout):
        self.waits.append(timeout)

    def recv(self, size):
        if not self.is_dripping:
            return super().recv(size)
        self.now += 1.0
        return b"x"


def test_bytes_that_trickle_in_do_not_prolong_a_wait():
    """3 s are waited for: then 2, then 1, and nothing came."""
    wire = Drip(FeedLoop())
    client = FeedClient("bench", wire, 5.0, clock=lambda: wire.now)
    wire.is_dripping, wire.waits = True, []
    assert client.receive(3.0) is None
    assert wire.waits == [3.0, 2.0, 1.0]
