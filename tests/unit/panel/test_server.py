"""A panel on a port, in front of a bench: what gets in, what gets through, and what is refused."""

import asyncio
import contextlib
import json
import socket
import tomllib
from dataclasses import replace
from http.client import HTTPConnection

import pytest
from support.live_bench import SECRET, LiveBench, live_bench, panel, runtime_folder
from support.patience import GUARD
from support.tables import from_text
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from hil_bench.abilities.live.messages import MOST_REQUEST
from hil_bench.abilities.panel import app, hub
from hil_bench.abilities.panel import hub as hub_module
from hil_bench.abilities.panel.bench_link import BenchLink
from hil_bench.abilities.panel.hub import MOST_VIEWERS, BusFindings, FrameNews, Hub, Viewer
from hil_bench.abilities.panel.record import RecordForm, make_scenario, write_test
from hil_bench.abilities.panel.server import open_port, read_password
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.errors import BusError, ConfigError, WaitTimeoutError


@pytest.fixture
def folder(monkeypatch):
    with runtime_folder(monkeypatch) as folder:
        yield folder


class Client:
    """A browser without a page."""

    def __init__(self, port, secret=SECRET, origin=None):
        self.stack = contextlib.ExitStack()
        address = f"ws://127.0.0.1:{port}/feed"
        origin = origin or f"http://127.0.0.1:{port}"
        self.socket = self.stack.enter_context(connect(address, origin=origin, open_timeout=GUARD))
        self.lines = []
        self.kept = []  # what has happened before an answer came
        self.number = 0
        self.socket.send(json.dumps({"token": secret}))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stack.close()

    def hear(self, kind, fits=bool):
        """Return the next message of a type."""
        for number, message in enumerate(self.kept):
            if message["type"] == kind and fits(message):
                return self.kept.pop(number)
        while True:
            while self.lines:
                message = json.loads(self.lines.pop(0))
                if message["type"] == kind and fits(message):
                    return message
                if kind == "answer" and message["type"] in {"event", "frames"}:
                    self.kept.append(message)
            self.lines += self.socket.recv(timeout=GUARD).splitlines()

    def ask(self, action, **fields):
        self.number += 1
        self.socket.send(json.dumps({"id": self.number, "do": action, **fields}))
        answer = self.hear("answer", lambda message: message["id"] == self.number)
        assert "error" not in answer, answer["error"]
        return answer["value"]

    def refused(self, text):
        self.socket.send(text)
        return self.hear("answer")["error"]


@pytest.mark.usefixtures("folder")
def test_a_page_sees_the_bench_and_breaks_it():
    with live_bench() as bench, panel() as port, Client(port) as client:
        hello = client.hear("hello")
        assert hello["channels"] == [list(channel) for channel in bench.session.channels]
        offset = hello["fault_kinds"]["offset"]
        assert [key["name"] for key in offset["position"]] == ["offset_mm", "for_s"]
        assert len(client.hear("rows")["rows"][0]) == 1 + len(bench.session.channels)
        keys = {"offset_bar": 20, "for_s": 60}
        number = client.ask("fault", kind="offset", target="pressure_a", keys=keys)
        event = client.hear("event")
        assert (event["kind"], event["target"], event["begins"]) == ("offset", "pressure_a", True)
        (entry,) = client.ask("journal")["entries"]
        # 20 bar are 2 MPa.
        assert entry["fields"]["arguments"] == {"amount": 2e6, "duration": 60.0}
        client.ask("clear_fault", number=number)
        assert client.ask("get_object", node="valve", name="0x6040.00") == 0
        names = [each["name"] for each in client.ask("objects", node="valve")]
        assert "0x6040.00" in names
        tpdo = next(pdo for pdo in client.ask("pdos") if pdo["id"] == 0x181)
        assert tpdo["node"] == "valve"
        assert [each["name"] for each in tpdo["signals"]] == ["0x6041.00", "0x6301.01"]
        assert [each["shift"] for each in tpdo["signals"]] == [0, 16]
        assert [(each["type"], each["bits"]) for each in tpdo["signals"]] == [
            ("UNSIGNED16", 16),
            ("INTEGER16", 16),
        ]
        assert all(each["text"] for each in tpdo["signals"])


@pytest.mark.usefixtures("folder")
def test_a_page_records_into_the_folder_of_the_panel(tmp_path):
    with live_bench(), panel(folder=tmp_path) as port, Client(port) as client:
        client.hear("hello")
        client.ask("record", file="run.mf4")
        client.hear("rows")
        found = client.ask("stop_recording")
        assert found["path"] == str(tmp_path / "run.mf4")
        assert found["rows"] == len(read_recording(tmp_path / "run.mf4")) > 0
        again = json.dumps({"id": 9, "do": "record", "file": "run.mf4"})
        assert "run.mf4 is there already; give another name" in client.refused(again)
        for name in ("../run.mf4", "/run.mf4", "run.csv", ".mf4", "run.mf4\n"):
            wrong = json.dumps({"id": 9, "do": "record", "file": name})
            assert "give up to 61 letters, digits" in client.refused(wrong)
    assert [path.name for path in tmp_path.iterdir()] == ["run.mf4"]


@pytest.mark.usefixtures("folder")
def test_frames_come_to_who_wants_them():
    with live_bench(), panel() as port, Client(port) as client:
        client.hear("rows")
        client.ask("want", frames=True)
        client.ask("fault", kind="reset", target="valve")
        frames = client.hear("frames")["frames"]
        assert [each[3] for each in frames] == [0x701]  # boot-up of node 1 (CiA 301)


WRONG_SECRETS = [
    '{"token": "wrong"}',
    "{}",
    "[]",
    "nonsense",
    "[" * 50_000,
    '{"id": 1, "do": "stop"}',
]


@pytest.mark.usefixtures("folder")
def test_requests_beyond_those_that_may_be_open_wait_for_their_turn(monkeypatch):
    monkeypatch.setattr("hil_bench.abilities.panel.app.MOST_OPEN", 1)
    with live_bench(), panel() as port, Client(port) as client:
        for number in range(3):
            client.socket.send(json.dumps({"id": number, "do": "pdos"}))
        assert [client.hear("answer")["id"] for _ in range(3)] == [0, 1, 2]


@pytest.mark.usefixtures("folder")
def test_nothing_is_shown_or_done_without_the_secret(monkeypatch):
    monkeypatch.setattr("hil_bench.abilities.panel.app._PENANCE", 0.0)
    with live_bench() as bench, panel() as port:
        for text in WRONG_SECRETS:
            address = f"ws://127.0.0.1:{port}/feed"
            with connect(address, origin=f"http://127.0.0.1:{port}") as browser:
                browser.send(text)
                (answer,) = browser.recv(timeout=GUARD).splitlines()
                assert json.loads(answer)["type"] == "refused", text
                with pytest.raises(ConnectionClosed):
                    browser.recv(timeout=GUARD)
        assert bench.session.controls.is_over is False


HALF_REQUESTS = [
    b"",
    b"GET / HTTP/1.1\r\nHost: x",
    b"POST /mf4 HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\nContent-Length: 9\r\n\r\n{",
    b"GET /feed HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\nUpgrade: websocket\r\n",
]


@pytest.mark.usefixtures("folder")
def test_half_requests_keep_nobody_out_and_the_oldest_go(caplog, monkeypatch):
    monkeypatch.setattr(app, "ROOM", 16)
    with live_bench(), panel() as port, contextlib.ExitStack() as stack:
        attackers = []
        for request in 16 * HALF_REQUESTS:
            attacker = socket.create_connection(("127.0.0.1", port), GUARD)
            stack.callback(attacker.close)
            attacker.sendall(request.replace(b"PORT", b"%d" % port))
            attackers.append(attacker)
        with Client(port) as client:
            assert client.hear("hello")["name"] == "bench"
            with contextlib.suppress(ConnectionResetError):
                while attackers[0].recv(4096):
                    pass
    assert not [record for record in caplog.records if record.exc_info]


@pytest.mark.usefixtures("folder")
def test_browsers_without_the_secret_keep_nobody_out(monkeypatch):
    monkeypatch.setattr(app, "ROOM", 8)
    with live_bench(), panel() as port, contextlib.ExitStack() as stack:
        address = f"ws://127.0.0.1:{port}/feed"
        for _ in range(20):
            stack.enter_context(connect(address, origin=f"http://127.0.0.1:{port}"))
        with Client(port) as client:
            assert client.hear("hello")["name"] == "bench"


@pytest.mark.usefixtures("folder")
def test_a_page_that_looks_stays_and_an_idle_connection_makes_room(monkeypatch):
    """A browser keeps its connection after a request, and may say nothing more."""
    monkeypatch.setattr(app, "ROOM", 2)
    monkeypatch.setattr(app._Http, "timeout_keep_alive_handler", lambda _: None)  # after 5 s
    with live_bench(), panel() as port, Client(port) as client, contextlib.ExitStack() as stack:
        client.hear("hello")
        idle = []
        for _ in range(3):
            browser = HTTPConnection("127.0.0.1", port, timeout=GUARD)
            stack.callback(browser.close)
            browser.request("GET", "/")
            browser.getresponse().read()
            idle.append(browser.sock)
        assert idle[0].recv(1) == b""
        assert client.ask("get_object", node="valve", name="0x6040.00") == 0


@pytest.mark.usefixtures("folder")
def test_bad_utf8_ends_its_connection_without_a_traceback(caplog):
    with live_bench(), panel() as port:
        address = f"ws://127.0.0.1:{port}/feed"
        with connect(address, origin=f"http://127.0.0.1:{port}") as browser:
            frame = b"\x81\x82\0\0\0\0\xff\xff"  # FIN and text, two masked bytes: no UTF-8
            browser.socket.sendall(100 * frame)
            with pytest.raises(ConnectionClosed) as ended:
                browser.recv(timeout=GUARD)
        assert ended.value.rcvd.code == 1007
        with Client(port) as client:
            assert client.hear("hello")["name"] == "bench"
    assert caplog.messages == []


@pytest.mark.usefixtures("folder")
def test_a_page_of_somebody_else_is_turned_away():
    with live_bench(), panel() as port, pytest.raises(InvalidStatus, match="403"):
        Client(port, origin="http://evil.example")


@pytest.mark.usefixtures("folder")
def test_wrong_requests_are_answered_in_words():
    with live_bench(), panel() as port, Client(port) as client:
        client.hear("hello")
        assert client.refused("{") == "b'{' is not JSON in UTF-8"
        assert "do = 'watch': give one of" in client.refused('{"id": 1, "do": "watch"}')
        text = '{"id": 2, "do": "fault", "kind": "melt", "target": "valve"}'
        assert 'there is no kind "melt"' in client.refused(text)
        text = '{"id": 3, "do": "fault", "kind": "freeze", "target": "<b>x</b>"}'
        assert "pressure_a" in client.refused(text)
        text = '{"id": 4, "do": "objects", "node": "valve\\u0000"}'
        assert "give one of valve, pressure_a" in client.refused(text)
        text = '{"id": 5, "do": "choose", "bench": "../../x"}'
        assert "does not run; give one of bench" in client.refused(text)
        assert client.ask("get_object", node="valve", name="0x6040.00") == 0  # it goes on


@pytest.mark.usefixtures("folder")
def test_an_oversized_message_ends_its_own_connection_only():
    with live_bench(), panel() as port, Client(port) as good, Client(port) as bad:
        good.hear("hello")
        bad.hear("hello")
        with contextlib.suppress(ConnectionClosed):
            bad.socket.send("x" * (MOST_REQUEST + 1))
        with pytest.raises(ConnectionClosed):
            bad.hear("nothing")
        assert bad.socket.close_code == 1009
        assert good.ask("get_object", node="valve", name="0x6040.00") == 0


@pytest.mark.usefixtures("folder")
def test_bytes_end_the_connection():
    with live_bench(), panel() as port, Client(port) as client:
        client.hear("hello")
        client.socket.send(b"\x00")
        with pytest.raises(ConnectionClosed):
            client.hear("nothing")


@pytest.mark.usefixtures("folder")
def test_fifty_look_and_one_too_many_is_told_so():
    with contextlib.ExitStack() as stack:
        bench = LiveBench()
        stack.callback(bench.close)
        port = stack.enter_context(panel())
        first = stack.enter_context(Client(port))
        with bench.running():
            first.hear("rows")
        clients = [stack.enter_context(Client(port)) for _ in range(MOST_VIEWERS - 1)]
        for client in clients:
            assert client.hear("hello")["name"] == "bench"
        with bench.running():
            for client in clients:
                client.hear("rows")
        extra = stack.enter_context(Client(port))
        assert extra.hear("refused")["words"].startswith(f"{MOST_VIEWERS} browsers look")


@pytest.mark.usefixtures("folder")
def test_a_bench_that_ends_is_waited_for():
    with panel() as port, Client(port) as client:
        assert "no bench runs" in client.hear("panel", lambda status: status["words"])["words"]
        for _ in range(2):
            with live_bench():
                assert client.hear("panel", lambda status: status["bench"])["bench"] == "bench"
                client.hear("rows")
            status = client.hear("panel", lambda status: not status["bench"])
            assert "bench bench has ended; the page goes on" in status["words"]
        assert "no bench is connected" in client.refused('{"id": 1, "do": "stop"}')


@pytest.mark.usefixtures("folder")
def test_of_two_benches_one_is_chosen():
    with live_bench(), live_bench("other"), panel() as port, Client(port) as client:
        status = client.hear("panel", lambda status: status["words"])
        assert status["words"] == "2 benches run; name one of bench, other"
        client.ask("choose", bench="other")
        assert client.hear("hello")["name"] == "other"
        client.ask("choose", bench="bench")
        assert client.hear("hello")["name"] == "bench"


@pytest.mark.usefixtures("folder")
def test_a_panel_can_end_with_its_bench():
    with contextlib.ExitStack() as stack:
        bench = stack.enter_context(live_bench())
        port = stack.enter_context(panel(is_once=True))
        client = stack.enter_context(Client(port))
        client.hear("rows")
        bench.feed.stop()
        with pytest.raises(ConnectionClosed):
            client.hear("nothing")


def test_a_port_in_use_is_told_and_the_usual_one_gives_way():
    with contextlib.closing(open_port("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(BusError, match=f"panel: 127.0.0.1 port {port}: Address already in use"):
            open_port("127.0.0.1", port)


def test_the_usual_port_gives_way(monkeypatch):
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = taken.getsockname()[1]
        monkeypatch.setattr("hil_bench.abilities.panel.server.DEFAULT_PORT", port)
        with contextlib.closing(open_port("127.0.0.1", None)) as listener:
            assert listener.getsockname()[1] != port


def test_a_password_is_for_its_owner_only(tmp_path, make_file):
    path = make_file("password", "correct horse battery\nrest")
    path.chmod(0o600)
    assert read_password(path) == "correct horse battery"
    path.chmod(0o640)
    with pytest.raises(ConfigError, match="others may read it; chmod 600"):
        read_password(path)
    path.chmod(0o600)
    path.write_text("short", encoding="utf-8")
    with pytest.raises(ConfigError, match="has 5 characters; give 12 or more"):
        read_password(path)
    with pytest.raises(ConfigError, match="cannot be read"):
        read_password(tmp_path / "absent")


@from_text("words", "error")
def test_wrong_arguments_are_one_line(words, error, cli):
    assert error in cli(["panel", *words.split()], 2).err


FORM = {
    "file": "clicked",
    "title": "Clicked",
    "begin_s": 0.0,
    "end_s": 5.0,
    "lead_s": 0.5,
    "controller": "",
    "requirement": "REQ-1",
    "that": "always pressure_a.measured < 100 bar",
}


@pytest.mark.long  # two runs of hil-bench test, each in a process of its own
@pytest.mark.usefixtures("folder")
def test_what_was_clicked_is_written_as_a_test_and_runs(tmp_path):
    with live_bench(), panel(folder=tmp_path) as port, Client(port) as client:
        client.hear("rows")
        # At rest about 50 bar: 80 bar more break the requirement of 100 bar.
        client.ask("fault", kind="offset", target="pressure_a", keys={"offset_bar": 80})
        end = client.ask("journal")["entries"][0]["time"] + 0.2
        form = {**FORM, "end_s": end}
        found = client.ask("test", **form, replaces=False)
        assert found["verdict"] == "failed"
        path = tmp_path / "clicked.scenario.toml"
        assert found["path"] == str(path)
        scenario = load_scenario(path)
        (step,) = scenario.steps
        assert (step.kind, step.target, dict(step.values)) == (
            "offset",
            "pressure_a",
            {"offset_bar": 80.0},
        )
        assert step.at == pytest.approx(end - 0.2 + 0.5)
        assert scenario.duration == pytest.approx(end + 0.5)
        answer = client.refused(json.dumps({"id": 90, "do": "test", **form, "replaces": False}))
        assert answer.endswith("is there already; give another name, or replace it")
        wrong = {**form, "that": "always nothing < 5 bar", "replaces": True}
        answer = client.refused(json.dumps({"id": 91, "do": "test", **wrong}))
        assert '"nothing" is no signal here' in answer
        preview = client.ask("preview", **{**form, "file": "other"})
        assert 'fault = "offset"' in preview["text"]
        assert not (tmp_path / "other.scenario.toml").exists()


@pytest.mark.usefixtures("folder")
def test_a_test_is_shown_before_it_is_written(tmp_path, monkeypatch):
    async def play(path):
        return {"verdict": f"of {path.name}"}

    monkeypatch.setattr("hil_bench.abilities.panel.desk.play_test", play)
    with live_bench(), panel(folder=tmp_path) as port, Client(port) as client:
        client.hear("hello")
        found = client.ask("preview", **FORM)
        assert found["path"] == str(tmp_path / "clicked.scenario.toml")
        content = tomllib.loads(found["text"])
        assert (content["title"], content["duration_s"]) == ("Clicked", 5.5)
        assert [each["id"] for each in content["expect"]] == ["REQ-1"]
        assert list(tmp_path.iterdir()) == []
        played = client.ask("test", **FORM, replaces=False)
        assert (played["path"], played["verdict"]) == (found["path"], "of clicked.scenario.toml")
        assert (tmp_path / "clicked.scenario.toml").read_text() == found["text"]


def test_a_test_that_was_clicked_is_written_once_and_lasts_whole_nanoseconds(tmp_path):
    path = tmp_path / "clicked.scenario.toml"
    form = RecordForm(**{**FORM, "begin_s": 1.0, "end_s": 1.0 + 1.0 / 3.0, "lead_s": 0.5})
    scenario, remarks = make_scenario(form, path, {}, {"entries": [], "forgotten": 0})
    assert (scenario.duration, remarks) == (0.833333333, [])
    write_test(scenario, replaces=False)
    assert load_scenario(path).duration == 0.833333333
    with pytest.raises(ConfigError, match="is there already; give another name, or replace it"):
        write_test(scenario, replaces=False)
    write_test(scenario, replaces=True)
    lost = replace(scenario, path=tmp_path / "no" / "clicked.scenario.toml")
    with pytest.raises(ConfigError, match=r"there is no folder .*; make it first"):
        write_test(lost, replaces=False)


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"file": "../x"}, "file '../x': give up to 61 letters"),
        ({"file": ""}, "file '': give"),
        ({"end_s": -1.0}, "from 0 s to -1 s: give a time of up to 600 s"),
        ({"end_s": 1e6}, "give a time of up to 600 s"),
        ({"lead_s": -1.0}, "lead -1 s: give 0 to 600 s"),
        ({"controller": "nobody"}, "give one of position_control, manual, or none"),
        ({"that": " "}, "give a title, an id and a requirement"),
    ],
)
def test_a_wrong_form_is_refused(change, error, tmp_path):
    form = RecordForm(**{**FORM, **change})
    with pytest.raises(ConfigError) as caught:
        make_scenario(form, tmp_path / "x.scenario.toml", {}, {"entries": [], "forgotten": 0})
    assert error in str(caught.value)


# The middle of a panel: what it asks a bench for, and what it says when there is none.


async def send_nowhere(_lines):
    """Take what a browser would."""


class Link:
    """A bench that is asked for things."""

    name = "bench"

    def __init__(self, on_request):
        self.hello = {"fault_targets": {}}
        self.asked = []
        self.on_request = on_request

    async def request(self, action, **fields):
        self.asked.append((action, fields))
        self.on_request(len(self.asked))


def care(hub, link):
    """Let a hub care for a bench until it has nothing more to ask for."""

    async def run():
        task = asyncio.create_task(hub._care(link))
        for _ in range(20):
            await asyncio.sleep(0)
        task.cancel()

    asyncio.run(run())


def test_a_browser_that_comes_while_the_bench_is_asked_gets_rows():
    hub = Hub()
    viewer = Viewer(send_nowhere)
    link = Link(lambda number: hub.admit(viewer) if number == 1 else None)
    care(hub, link)
    assert [fields["rows_every_s"] for _, fields in link.asked] == [None, 0.0]


def test_frames_are_asked_for_where_one_of_several_browsers_shows_them():
    hub, link = Hub(), Link(lambda _number: None)
    viewers = [Viewer(send_nowhere) for _ in range(2)]
    for viewer in viewers:
        hub.admit(viewer)
    viewers[1].wants_marks = True
    care(hub, link)
    assert [fields["frames"] for _, fields in link.asked] == [True]


def test_a_browser_that_comes_later_is_told_what_has_happened():
    hub = Hub()
    hub.link = Link(lambda _number: None)
    for kind in ("event", "command", "rows", "frames"):
        hub._take(kind, f'{{"type":"{kind}"}}\n'.encode(), {})
    viewer = Viewer(send_nowhere)
    hub.admit(viewer)
    kinds = [json.loads(line).get("type") for line in b"".join(viewer._waiting).splitlines()]
    assert kinds[-2:] == ["event", "command"]
    assert not {"rows", "frames"} & {*kinds}


@pytest.mark.parametrize(
    "frames",
    [
        '"other": 5',
        '"frames": 5',
        '"frames": [5]',
        '"frames": [[0.0, 0, "in", 385, "00"]]',
        '"frames": [[0.0, 0, "in", 385, "0z", false, false, false]]',
        '"frames": [[1e999, 0, "in", 385, "00", false, false, false]]',
        '"frames": [[0.0, -9, "in", 385, "00", false, false, false]]',
        '"frames": [[0.0, 0, "in", "181", "00", false, false, false]]',
        '"frames": [[0.0, {}, "in", 385, "00", false, false, false]]',
        '"frames": ' + 5000 * "[" + 5000 * "]",
    ],
)
def test_frames_of_a_bench_that_are_no_frames_are_refused(frames):
    hub, viewer = Hub(), Viewer(send_nowhere)
    hub.admit(viewer)
    viewer.wants_frames = True
    hub.link = Link(lambda _number: None)
    hub.link.hello = {"bus_rates": [[500000, 1.0]]}
    with pytest.raises(BusError, match="the bench's message of frames is not one"):
        hub._take("frames", f'{{"type": "frames", {frames}}}\n'.encode(), {})


def test_what_a_bench_did_not_hear_is_asked_again(monkeypatch):
    monkeypatch.setattr(hub_module, "RETRY", 0.0)

    def fail_once(number):
        if number == 1:
            raise WaitTimeoutError("no answer in 5 s")

    link = Link(fail_once)
    hub = Hub()
    hub.admit(Viewer(send_nowhere))
    care(hub, link)
    assert [fields["rows_every_s"] for _, fields in link.asked] == [0.0, 0.0]


def test_a_bench_that_does_not_greet_is_given_up():
    async def greet():
        await BenchLink("bench", asyncio.StreamReader(), None, timeout=0.0).greet()

    with pytest.raises(WaitTimeoutError, match="bench bench: no greeting"):
        asyncio.run(greet())


class Ending(Link):
    """A bench that ends at once."""

    async def __aenter__(self):
        return self

    async def __aexit__(self, *_):
        pass

    async def listen(self, _take):
        raise BusError("bench bench has ended")


@pytest.mark.parametrize("error", ["no bench runs", "bench bench: the connection is lost"])
def test_that_a_bench_has_ended_is_said_until_one_runs_again(monkeypatch, error):
    words = []
    links = [Ending(lambda _: None), BusError(error), Ending(lambda _: None)]

    async def open_link(_name):
        words.append(hub._status["words"])
        found = links.pop(0)
        if isinstance(found, BusError):
            raise found
        return found

    monkeypatch.setattr(hub_module, "find_names", lambda: ["bench"])
    monkeypatch.setattr(hub_module, "open_link", open_link)
    monkeypatch.setattr(hub_module, "RETRY", 0.0)
    hub = Hub()
    with pytest.raises(IndexError):
        asyncio.run(hub.run())
    ended = "bench bench has ended; the page goes on when it runs again"
    assert words == ["", ended, ended, ended]


# A panel that ends with its bench, and a bench that was killed before the panel was there.


class EnoughError(Exception):
    """Ends a panel that would go on."""


@pytest.fixture
def running(monkeypatch):
    """Return a list to be filled: which benches run, look by look; nobody answers in any."""
    looks = []

    def find_names():
        if not looks:
            raise EnoughError
        return looks.pop(0)

    async def open_link(name):
        raise BusError(f"bench {name}: the connection is lost")

    monkeypatch.setattr(hub, "find_names", find_names)
    monkeypatch.setattr(hub, "open_link", open_link)
    monkeypatch.setattr(hub, "RETRY", 0.0)
    return looks


@pytest.mark.parametrize("looks", [[[]], [["left"], ["left"], ["other"]]])
def test_a_bench_that_is_gone_before_it_was_seen_ends_the_panel(running, looks):
    running += looks
    with pytest.raises(BusError, match="bench left does not run; the panel ends with it"):
        asyncio.run(hub.Hub("left").run(is_once=True))
    assert running == []


@pytest.mark.parametrize(("name", "is_once"), [(None, True), ("left", False)])
def test_other_panels_wait_for_a_bench(running, name, is_once):
    running += [[]] * 5
    with pytest.raises(EnoughError):
        asyncio.run(hub.Hub(name).run(is_once=is_once))


# Which frames a scope marks; identifiers are those of CiA 301's predefined connection set.


def frame(identifier, data="", *, time=0.0, bus=0, extended=False, remote=False, fd=False):
    return [time, bus, "out", identifier, data, extended, remote, 4 * fd]


def test_emcy_and_nmt_are_news_and_process_data_is_not():
    frames = [frame(0x000, "0100"), frame(0x081, "00"), frame(0x181, "11"), frame(0x080)]
    assert FrameNews().take(frames) == frames[:2]


def test_a_heartbeat_is_news_where_its_state_is_another_one():
    news = FrameNews()
    assert news.take([frame(0x701, "7f"), frame(0x701, "7f")]) == []
    assert news.take([frame(0x701, "05")]) == [frame(0x701, "05")]
    assert news.take([frame(0x701, "05"), frame(0x702, "05"), frame(0x701, "7f", bus=1)]) == []


def test_frames_of_another_kind_are_no_news():
    assert (
        FrameNews().take(
            [frame(0x81, extended=True), frame(0x81, remote=True), frame(0x81, fd=True)]
        )
        == []
    )


def test_of_a_flood_the_newest_are_kept():
    frames = [frame(0x081, time=float(number)) for number in range(500)]
    found = FrameNews().take(frames)
    assert found == frames[-50:]


# What the page's view of the bus says is wrong.


DEVICES = {"valve": {"node_id": 1, "bus": 0}, "pressure": {"node_id": 2, "bus": 0}}


def beats(node, begin, end, bus=0):
    """Heartbeats each 100 ms, OPERATIONAL, as the feed has frames."""
    return [
        [time / 10, bus, "out", 0x700 + node, "05", False, False, 0] for time in range(begin, end)
    ]


def test_a_heartbeat_that_stops_is_told_once_and_by_name():
    findings = BusFindings(DEVICES)
    assert findings.take(sorted(beats(1, 0, 10) + beats(2, 0, 10))) is None
    told = [message for each in beats(2, 10, 40) if (message := findings.take([each])) is not None]
    (message,) = told
    assert message["type"] == "findings"
    (finding,) = message["findings"]
    assert finding["title"] == "heartbeat lost"
    assert finding["text"].startswith("valve: no heartbeat after 0.900 s")
    assert finding["bus"] == 0


def test_times_of_what_is_wrong_count_from_the_first_frame_that_was_seen():
    findings = BusFindings(DEVICES)
    message = findings.take(sorted(beats(1, 50, 60) + beats(2, 50, 90)))
    (finding,) = message["findings"]
    assert finding["since"] == 5.0
    assert finding["text"].startswith("valve: no heartbeat after 0.900 s")


def findings_shown(viewer):
    """Return the messages of what is wrong that wait for a browser."""
    messages = [json.loads(line) for line in b"".join(viewer._waiting).splitlines()]
    return [each["findings"] for each in messages if each.get("type") == "findings"]


def hub_with_viewer():
    """Return a hub before a bench with two nodes, and a browser that shows frames."""
    hub, viewer = Hub(), Viewer(send_nowhere)
    hub.link = Link(lambda _number: None)
    hub.link.hello = {**hub.link.hello, "devices": DEVICES, "bus_rates": [[1_000_000, 1.0]]}
    hub.admit(viewer)
    viewer.wants_frames = True
    return hub, viewer


def show(hub, frames):
    hub._take("frames", json.dumps({"frames": frames}).encode() + b"\n", {})


def test_what_a_bench_was_not_asked_for_is_no_silence():
    """A browser looks at the frames, then at another page for ten seconds, then again."""
    hub, viewer = hub_with_viewer()
    show(hub, sorted(beats(1, 0, 20) + beats(2, 0, 20)))
    viewer.wants_frames = False
    care(hub, hub.link)
    viewer.wants_frames = True
    care(hub, hub.link)
    show(hub, sorted(beats(1, 120, 160) + beats(2, 120, 160)))
    assert findings_shown(viewer) == []


def test_a_browser_that_begins_to_show_frames_sees_what_is_wrong_already():
    hub, _ = hub_with_viewer()
    show(hub, sorted(beats(1, 0, 10) + beats(2, 0, 40)))
    second = Viewer(send_nowhere)
    hub.admit(second)
    second.wants_frames = True
    hub.review()
    ((finding,),) = findings_shown(second)
    assert finding["title"] == "heartbeat lost"


def test_each_bus_is_judged_alone():
    """Node 1 of bus 1 goes on; the bench knows no device there."""
    findings = BusFindings(DEVICES)
    frames = sorted(beats(1, 0, 10) + beats(2, 0, 40) + beats(1, 0, 40, bus=1))
    message = findings.take(frames)
    assert [each["bus"] for each in message["findings"]] == [0]


def test_what_is_over_is_taken_back():
    """No NMT start for a second after boot-up, while others are started; then it comes."""
    findings = BusFindings(DEVICES)
    frames = [
        [0.0, 0, "out", 0x701, "00", False, False, 0],
        [0.1, 0, "in", 0, "0102", False, False, 0],
    ]
    frames += [[time / 10, 0, "out", 0x702, "05", False, False, 0] for time in range(2, 30)]
    assert findings.take(frames)["findings"][0]["title"] == "is not started"
    frames = [[3.0, 0, "in", 0, "0101", False, False, 0]]
    frames += [[time / 10, 0, "out", 0x702, "05", False, False, 0] for time in range(31, 60)]
    assert findings.take(frames)["findings"] == []


def test_the_load_of_can_fd_counts_at_both_rates():
    """1600 frames a second of 64 bytes with bit-rate switch, on 500 kbit/s.

    Each has 620 bits of data and CRC with their stuff bits, and 33 others: at one rate 200 % of the
    bus, with a data phase that is eight times faster 35 %.
    """
    frames = [[n / 1600, 0, "in", 0x100, "00" * 64, False, False, 5] for n in range(1600)]
    frames.append([1.0, 0, "in", 1, "", False, False, 0])
    at_once = BusFindings({}, [[500_000, 1.0]]).take(frames)
    assert [each["title"] for each in at_once["findings"]] == ["bus load"]
    assert BusFindings({}, [[500_000, 8.0]]).take(frames) is None
    # Of a bus that the greeting does not name: 1 Mbit/s at one rate, of which that is 104 %.
    at_usual = BusFindings({}).take(frames)
    assert [each["title"] for each in at_usual["findings"]] == ["bus load"]
