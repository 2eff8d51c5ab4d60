"""What the observers of a session are told, and in which order."""

import pytest

from hil_bench import RecordingWish, load_config
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.abilities.recording.sessions import recorded
from hil_bench.bench.session import open_session
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import Channel

TICK = 1_000_000
READ_DEVICE_TYPE = Frame(0x601, bytes.fromhex("4000100000000000"))


@pytest.fixture
def session():
    session = open_session(load_config())
    session.start()
    return session


def test_frames_come_before_the_row_and_the_row_before_the_time(session):
    told = []
    session.watch(ticks=lambda now: told.append(("time", now)))
    session.watch(rows=lambda row: told.append(("row", row[0])))
    session.watch(frames=lambda received, sent, now: told.append((len(received), len(sent), now)))
    session.tick((READ_DEVICE_TYPE,), TICK)
    # Four boot-up messages; the request comes before the node's, and is not answered.
    assert told == [(1, 4, TICK), ("row", TICK * 1e-9), ("time", TICK)]


def test_the_bus_does_not_wait_for_observers(session):
    happened = []
    session.watch(frames=lambda *_: happened.append("observed"))
    session.tick((), 0, lambda _frames: happened.append("sent"))
    session.serve((READ_DEVICE_TYPE,), lambda _frames: happened.append("answered"))
    assert happened == ["sent", "observed", "answered", "observed"]


def test_what_is_served_has_the_time_of_the_last_tick_and_brings_no_row(session):
    session.tick((), 3 * TICK)
    told = []
    session.watch(frames=lambda received, sent, now: told.append((received, sent, now)))
    session.watch(rows=told.append, ticks=told.append)
    answer = session.serve((READ_DEVICE_TYPE,))
    assert [frame.can_id for frame in answer] == [0x581]
    assert told == [((READ_DEVICE_TYPE,), answer, 3 * TICK)]
    assert session.now == 3 * TICK


def test_a_row_has_the_stimuli_first():
    session = open_session(load_config(), {Channel("force", "N"): lambda time: 3.0 * time})
    rows = []
    session.watch(rows=rows.append)
    session.start()
    session.tick((), 2 * TICK)
    assert [channel.name for channel in session.channels][:2] == ["force", "axis1.position"]
    (row,) = rows
    assert len(row) == 1 + len(session.channels)
    assert row[:2] == (0.002, pytest.approx(0.006))


def test_an_observer_may_leave(session):
    told = []
    session.watch(frames=told.append, rows=told.append, ticks=told.append)
    session.unwatch(frames=told.append, rows=told.append, ticks=told.append)
    session.tick((), 0)
    assert told == []


def test_a_recording_ends_with_its_block(session, tmp_path, monkeypatch):
    path = tmp_path / "run.csv"
    with recorded(session, RecordingWish((path,)), load_config(), is_real_time=False):
        session.tick((), 0)
        session.tick((), TICK)
    monkeypatch.setattr("hil_bench.bench.session.sample", None)  # nobody wants a row any more
    session.tick((), 2 * TICK)
    assert read_recording(path)["time"] == pytest.approx([0.0, 0.001])


def test_without_an_observer_of_rows_none_is_made(session, monkeypatch):
    monkeypatch.setattr("hil_bench.bench.session.sample", None)  # not even called
    session.watch(ticks=lambda _now: None)
    session.tick((), 0)
