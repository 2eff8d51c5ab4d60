"""Watches at their limits: gaps, jumps, jitter and silence, and what is just less than that."""

import can
import pytest

from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.abilities.eyes.explain.silence import Heartbeats, Silence
from hil_bench.abilities.eyes.explain.syncs import Syncs
from hil_bench.abilities.eyes.listener import Listener
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.abilities.hub.process import HubProcess
from hil_bench.canopen_device.frame import FDF, Frame
from hil_bench.errors import BusError

MS = 1_000_000


def sync(now, data=b""):
    return Sight(round(now * MS), Frame(0x80, data), Service.SYNC, "SYNC")


def nmt(now, command, node_id=0):
    return Sight(round(now * MS), Frame(0, bytes([command, node_id])), Service.NMT, "NMT")


def syncs(times, end, *, data=lambda _number: b"", also=()):
    watch = Syncs(Decoder())
    sights = [sync(now, data(number)) for number, now in enumerate(times)]
    for sight in sorted([*sights, *also], key=lambda each: each.now):
        watch.hear(sight)
    return [(each.cause, each.text) for each in watch.findings(round(end * MS))]


EVEN = [10 * number for number in range(21)]  # 200 ms


@pytest.mark.parametrize(
    ("times", "end", "also", "text"),
    [
        # Five periods and a second of silence, both: then it has stopped.
        (EVEN, 1200, (), None),
        (EVEN, 1200.001, (), "SYNC stops at 0.200 s (every 10 ms before)"),
        (EVEN, 1500, (nmt(210, 2),), None),
        (EVEN, 1500, (nmt(210, 2, 3),), "SYNC stops at 0.200 s (every 10 ms before)"),
        (EVEN, 1500, (nmt(205, 128), nmt(210, 1)), "SYNC stops at 0.200 s (every 10 ms before)"),
        (EVEN, 1500, (nmt(100, 2),), "SYNC stops at 0.200 s (every 10 ms before)"),
        ([0, 300, 600, 900, 1200], 4000, (), None),  # four intervals are no period
        ([0, 300, 600, 900, 1200, 1500], 3000, (), None),
        (
            [0, 300, 600, 900, 1200, 1500], 3000.001, (),
            "SYNC stops at 1.500 s (every 300 ms before)",
        ),
        # A gap is longer than 1.7 periods.
        ([*EVEN, 217], 217, (), None),
        (
            [*EVEN, 217.001, 227.001, 247.001], 250, (),
            "no SYNC for 17 ms after 0.200 s (every 10 ms); 2 such gaps",
        ),
    ],
)  # fmt: skip
def test_sync_has_a_gap_or_stops(times, end, also, text):
    found = [text for cause, text in syncs(times, end, also=also) if cause is Cause.SYNC_MISSING]
    assert found == ([] if text is None else [text])


@pytest.mark.parametrize(("late", "many"), [(2, 3), (2.5, 3), (2.5, 2), (5, 4)])
def test_sync_jitters_where_three_and_a_twentieth_are_a_fifth_off(late, many):
    times, now = [], 0.0
    for number in range(40):
        times.append(now)
        now += 10 + late * (number in range(22, 22 + many))
    found = [text for cause, text in syncs(times, now) if cause is Cause.SYNC_JITTER]
    assert len(found) == (late > 2.0 and many > 2)
    if found:
        assert f", {many} of 40 more than 20%" in found[0]


def test_the_counter_of_sync_goes_on_or_begins_anew_at_1():
    counts = [1, 2, 3, 1, 2, 4, 5, 7, 0, 240, 1]  # jumps to 4, 7, 0 and 240

    def data(number):
        return bytes([counts[number]])

    ((cause, text),) = syncs(range(0, 110, 10), 110, data=data)
    assert cause is Cause.SYNC_MISSING
    assert text == "the SYNC counter jumps 4 times: frames lost, or two producers"


def beat(now, node="valve", node_id=1):
    return Sight(
        round(now * MS),
        Frame(0x700 + node_id, b"\5"),
        Service.HEARTBEAT,
        "heartbeat",
        node,
        node_id,
    )


def lost(now, node):
    frame = Frame(0x82, bytes.fromhex("3081110000000000"))
    return Sight(round(now * MS), frame, Service.EMCY, "EMCY", node, 2)


BEATS = [100 * number for number in range(6)]


@pytest.mark.parametrize(
    ("times", "end", "also", "text"),
    [
        (BEATS, 750, (), None),  # 2.5 periods behind 500 ms
        (BEATS, 750.001, (), ", and none until the end"),
        (BEATS[:4], 2000, (), None),  # three intervals are no period
        (BEATS[:5], 2000, (), ", and none until the end"),
        ([*BEATS, 750], 800, (), None),
        ([*BEATS, 751], 800, (), ", for 251 ms"),
        ([*BEATS, 800, 900, 1200], 1200, (), ", for 300 ms; once more"),
        ([*BEATS, 800, 900, 1200, 1500], 1500, (), ", for 300 ms; 2 times more"),
        ([*BEATS, 800], 1200, (), ", for 300 ms; once more"),
        ([*BEATS, 800], 900, (lost(600, "sensor"),), ", for 300 ms; sensor reports it at 0.600 s"),
        ([*BEATS, 800], 900, (lost(600, "valve"),), ", for 300 ms"),
        ([*BEATS, 800], 900, (lost(499, "sensor"),), ", for 300 ms"),
        ([*BEATS, 9000], 9000, (lost(5500, "sensor"),), ", for 8500 ms"),
        ([*BEATS, 10500], 10500, (), ", for 10.0 s"),
        ([*BEATS, 1000500], 1000500, (), ", for 1000 s"),
        (BEATS, 2000, (nmt(600, 130),), None),
        (BEATS, 2000, (nmt(600, 129, 1),), None),
        (BEATS, 2000, (nmt(600, 130, 2),), ", and none until the end"),
        (BEATS, 2000, (nmt(600, 2),), ", and none until the end"),
    ],
)
def test_a_heartbeat_is_lost_after_two_and_a_half_periods(times, end, also, text):
    watch = Heartbeats(Decoder())
    for sight in sorted([*map(beat, times), *also], key=lambda each: each.now):
        watch.hear(sight)
    found = [each.text for each in watch.findings(round(end * MS))]
    last = 0.5 if len(times) > 5 else times[-1] / 1000
    begin = f"valve: no heartbeat after {last:.3f} s (every 100 ms before)"
    assert found == ([] if text is None else [begin + text])


def silence(
    gap, *, senders=((0x181, 10), (0x182, 20)), count=8, command=None, after=None, end=None
):
    """Frames of some senders with their periods, then nothing, then a frame."""
    watch = Silence()
    sights = [(period * n, Frame(can_id)) for can_id, period in senders for n in range(count)]
    stop = max(now for now, _ in sights)
    frames = [(now, f) for can_id, period in senders for f in [Frame(can_id)]
              for now in range(0, stop + 1, period)]  # fmt: skip
    if command is not None:
        frames.append((stop - command, Frame(0, b"\x80\x00")))
    for now, frame in sorted(frames, key=lambda each: each[0]):
        assert watch.take(frame, now * MS) == 0
    if end is not None:
        return list(watch.findings((stop + end) * MS))
    now = round((stop + gap) * MS)
    silent = watch.take(after or Frame(0x181), now)
    assert silent in {0, now - stop * MS}
    found = list(watch.findings(now))
    assert len(found) == bool(silent) == watch.gaps
    return found


@pytest.mark.parametrize(
    ("gap", "options", "is_one"),
    [
        (250, {}, False),
        (250.001, {}, True),
        (300, {"senders": ((0x181, 10), (0x281, 10))}, False),  # one node
        (300, {"senders": ((0x181, 10), (0x182, 140))}, False),  # 2.2 periods have not passed
        (309, {"senders": ((0x181, 10), (0x182, 140))}, True),
        (300, {"count": 6}, False),  # four intervals like the one before
        (300, {"count": 7}, True),
        (300, {"command": 299}, False),
        (300, {"command": 301, "count": 20}, True),
        (300, {"after": Frame(0x701, b"\0")}, False),  # a boot-up: they were off
        (300, {"after": Frame(0x701, b"\5")}, True),
        (300, {"after": Frame(0x701, b"\0", is_extended=True)}, True),
        (300, {"after": Frame(0x701, b"\0", fd=FDF)}, True),
        (300, {"senders": ((0x080, 10), (0x181, 10), (0x182, 20))}, False),  # they follow SYNC
        (300, {"senders": ((0x080, 10), (0x701, 20), (0x182, 20))}, True),
    ],
)
def test_a_bus_is_silent_where_two_senders_that_are_due_stay_out(gap, options, is_one):
    assert bool(silence(gap, **options)) is is_one


def test_a_bus_that_is_silent_to_the_end_is_told():
    (found,) = silence(0, end=251)
    assert found.text == (
        "nothing is on the bus for 251 ms after 0.140 s, of 2 senders that were due"
    )
    assert silence(0, end=250) == []


# The end of a bus, as who only listens hears it.


def listen_for_ever(listener):
    while True:  # pytest-timeout ends it where nothing is said
        listener.hear(0.01)


def test_a_hub_that_ends_is_a_lost_bus_and_silence_is_none():
    """It needs the real client: python-can returns None for an end of file, as for silence."""
    with HubProcess(port=0, channels=("can0",)) as hub:
        bus = can.Bus(
            interface="socketcand", channel="can0", host=hub.host, port=hub.port, ignore_config=True
        )
        listener = Listener(bus, "can0")
        assert listener.hear(0.0) is None
    with bus, pytest.raises(BusError, match="can0: bus lost: socketcand has closed the connection"):
        listen_for_ever(listener)
