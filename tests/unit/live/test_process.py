"""The socket, its permissions, and the process that serves it: started, killed, started again."""

import errno
import fcntl
import os
import signal
import socket
import stat
import threading

import pytest
from support.patience import GUARD

import hil_bench
from hil_bench import BusError, ConfigError, load_config
from hil_bench.abilities.common.shared_ring import SharedRing
from hil_bench.abilities.live.places import Place, check_name, find_names, place_of, runtime_folder
from hil_bench.abilities.live.server import CAPACITY, MOST_COMMANDS, FeedPlan, FeedProcess
from hil_bench.abilities.live.session_feed import Feed
from hil_bench.abilities.live.view import hello_of
from hil_bench.bench.session import open_session
from hil_bench.cli import main

TICK = 1_000_000


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path / "hil-bench"


class Running:
    """A bench that ticks in a thread, as fast as nobody minds."""

    def __init__(self, name="bench"):
        config = load_config()
        self.session = open_session(config)
        self.place = Place(name)
        self.plan = FeedPlan(
            hello_of(name, config, self.session),
            1 + len(self.session.channels),
            SharedRing(CAPACITY),
            SharedRing(MOST_COMMANDS),
        )
        self.process = FeedProcess(self.place.listener, self.plan)
        self.feed = Feed(self.session, self.process, self.plan)
        self.over = threading.Event()
        self.thread = threading.Thread(target=self.run)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.over.set()
        self.thread.join()

    def run(self):
        self.session.start()
        now = 0
        while not self.over.wait(0.001):
            self.session.tick((), now)
            self.feed.look()
            now += TICK
        self.feed.stop()
        self.place.release()


def exhaust(bench):
    """Ask the bench until its server is gone."""
    for _ in range(1000):
        bench.latest()


def test_a_bench_is_watched_killed_and_watched_again():
    with Running() as running:
        assert running.process.pid is None  # nobody has asked yet
        assert find_names() == ["bench"]
        assert running.process.pid is None  # and that was no question
        with hil_bench.attach(timeout=GUARD) as bench:
            bench.faults.freeze("pressure_a")
            first = running.process.pid
            os.kill(first, signal.SIGKILL)
            with pytest.raises(BusError, match="bench bench: the connection is lost"):
                exhaust(bench)
        with hil_bench.attach(timeout=GUARD) as bench:
            (fault,) = bench.status()["state"]["faults"]
            assert fault["target"] == "pressure_a"
            assert running.process.pid not in {None, first}
            rows = bench.rows()
            next(rows)
            running.over.set()
            assert all("axis1.position" in row for row in rows)  # it ends with the bench
    assert find_names() == []
    with pytest.raises(BusError, match='no bench with the name "bench" runs'):
        hil_bench.attach("bench")


def test_a_server_that_cannot_start_is_tried_again(monkeypatch, caplog):
    def refuse(_self):
        raise OSError(errno.EAGAIN, "Resource temporarily unavailable")

    monkeypatch.setattr("hil_bench.abilities.live.server.HelperProcess.start", refuse)
    place, now = Place("a"), [0]
    ring = SharedRing(64)
    process = FeedProcess(place.listener, FeedPlan({}, 1, ring, ring), clock=lambda: now[0])
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        client.connect(str(place_of("a")))
        for second in range(2):
            now[0] = second * 10**9
            assert not process.look()
            process._start.join()
            now[0] += 10**8
            assert not process.look()
            assert process._start is None  # not at once
    text = "feed: its process cannot be started (Resource temporarily unavailable); the next client"
    assert [message.startswith(text) for message in caplog.messages] == [True, True]
    process.stop()
    place.release()


def test_the_socket_is_for_its_user_alone(folder):
    place = Place("a")
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert stat.S_IMODE(place_of("a").stat().st_mode) == 0o600
    place.release()
    assert not place_of("a").exists()


def test_a_name_is_for_one_bench():
    place = Place("a")
    with pytest.raises(ConfigError, match='a bench with the name "a" runs already; give another'):
        Place("a")
    place.release()
    Place("a").release()


def test_what_a_killed_bench_leaves_is_no_bench():
    place = Place("a")
    place._lock.close()  # as the end of its process does
    place.listener.close()
    assert find_names() == []
    Place("a").release()


@pytest.mark.parametrize("mode", [0o750, 0o705, 0o777])
def test_a_folder_that_others_may_enter_is_refused(folder, mode):
    folder.mkdir()
    folder.chmod(mode)
    with pytest.raises(BusError, match="must be a folder that only its owner may enter"):
        Place("a")
    assert find_names() == []


def test_who_looks_is_not_taken_for_a_bench(folder):
    """A killed bench leaves both files; `ctl list` and `watch` look at the same time."""
    place = Place("a")
    assert find_names() == ["a"]
    place.release()
    (folder / "a.sock").touch()
    with (folder / "a.lock").open("rb") as other:
        fcntl.flock(other, fcntl.LOCK_SH)
        assert find_names() == []


def test_a_link_is_no_folder(folder, tmp_path):
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    folder.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(BusError, match="must be a folder"):
        Place("a")


@pytest.mark.parametrize("name", ["", "../a", "a/b", ".a", "-a", "a" * 41, "a\n", "é"])
def test_a_name_is_plain(name):
    with pytest.raises(ConfigError, match="give up to 40 letters, digits"):
        check_name(name)


def test_a_long_path_is_refused(monkeypatch, tmp_path):
    deep = tmp_path / ("d" * 100)
    deep.mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(deep))
    with pytest.raises(BusError, match="longer than 107 bytes; set XDG_RUNTIME_DIR shorter"):
        Place("a")


def test_without_a_runtime_folder_it_is_among_the_temporary_files(monkeypatch, tmp_path):
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert runtime_folder() == tmp_path / f"hil-bench-{os.getuid()}"


def test_a_run_without_a_folder_goes_on_unwatched(folder, cli):
    folder.write_text("")
    run = ["run", "-i", "virtual", "-c", "feed", "--speed", "max", "--duration", "0.01"]
    (line,) = [line for line in cli(run).err.splitlines() if "feed:" in line]
    assert line.endswith("the run goes on, and nobody can watch it")
    assert "feed:" not in cli([*run, "--no-feed"]).err


def test_a_run_looks_at_its_feed_in_each_tick(monkeypatch):
    looks = []
    monkeypatch.setattr(Feed, "look", lambda _self: looks.append(1))
    run = ["run", "-i", "virtual", "-c", "feed", "--speed", "max", "--duration", "0.01"]
    assert main(run) == 0
    assert len(looks) == 10  # ticks of 1 ms


def test_a_name_that_is_taken_ends_a_run(capsys):
    place = Place("a")
    run = ["run", "-i", "virtual", "-c", "feed", "--speed", "max", "--duration", "0.01"]
    assert main([*run, "--name", "a"]) == 2
    assert 'a bench with the name "a" runs already; give another name' in capsys.readouterr().err
    place.release()
