"""What the door writes down, and the requests that came with the page."""

import pytest
from support.feed_loop import FeedLoop

from hil_bench.abilities.faults.live import fault_fields, fault_table
from hil_bench.abilities.live import attached
from hil_bench.bench.commands import MOST_BYTES, MOST_ENTRY, Journal
from hil_bench.errors import ConfigError

HELLO = {"channels": [["pressure_a.measured", "Pa"], ["position.measured", "m"]]}


@pytest.fixture
def loop():
    return FeedLoop()


def entries(client):
    return client.request("journal")["entries"]


def test_each_command_that_acted_is_written_down(loop):
    client = loop.connect()
    number = client.request("begin_fault", kind="freeze", target="pressure_a")
    client.request("set_plant", axis="axis1", quantity="load", value=5000)
    client.request("set_object", node="valve", name="0x1017", value=500)
    client.request("get_object", node="valve", name="0x1017")
    client.request("mark", text="here")
    client.request("clear_fault", number=number)
    done = entries(client)
    assert [each["do"] for each in done] == [
        "begin_fault",
        "set_plant",
        "set_object",
        "mark",
        "clear_fault",
    ]
    assert done[0]["number"] == number
    assert done[1]["fields"] == {"axis": "axis1", "quantity": "load", "value": 5000}
    times = [each["time"] for each in done]
    assert times == sorted(times)


def test_a_command_that_was_refused_is_not(loop):
    client = loop.connect()
    with pytest.raises(ConfigError):
        client.request("set_plant", axis="axis9", quantity="load", value=1)
    assert entries(client) == []


def test_who_watches_hears_of_it_at_its_time(loop):
    watcher, other = loop.connect(), loop.connect()
    watcher.request("watch")
    other.request("mark", text="here")
    heard = [message for _ in range(9) if (message := watcher.receive(0.2))]
    (entry,) = [message for message in heard if message["type"] == "command"]
    assert entry["do"] == "mark"
    assert entry["fields"] == {"text": "here"}
    assert entry["time"] == entries(other)[0]["time"]


def test_a_stop_ends_the_run(loop):
    assert loop.session.controls.is_over is False
    loop.connect().request("stop")
    assert loop.session.controls.is_over is True


def test_a_loop_without_real_time_has_no_histograms(loop):
    assert loop.connect().request("histograms") is None


def test_the_journal_stays_within_its_bytes():
    journal = Journal()
    for number in range(MOST_BYTES // 100):
        journal.add(number, "mark", {"text": "x" * 100})
    content = journal.content()
    assert content["forgotten"] > 0
    assert content["entries"][-1]["entry"] == MOST_BYTES // 100
    assert sum(len(repr(each)) for each in content["entries"]) < 2 * MOST_BYTES


def test_a_long_entry_is_kept_without_its_values():
    assert Journal().add(0, "set_object", {"value": "x" * MOST_ENTRY})["fields"] == {}


@pytest.mark.parametrize(
    ("table", "arguments"),
    [  # a bar is 1e5 Pa, a millimetre 1e-3 m, a millisecond 1e-3 s
        ({"kind": "offset", "target": "pressure_a", "offset_bar": 20.0}, {"amount": 2e6}),
        ({"kind": "offset", "target": "position", "offset_mm": 3.0}, {"amount": 3e-3}),
        ({"kind": "freeze", "target": "position", "for_s": 1.5}, {"duration": 1.5}),
        ({"kind": "slow", "target": "valve", "time_constant_ms": 50.0}, {"time_constant": 0.05}),
        ({"kind": "break_wire", "target": "pressure_a", "reads": "low"}, {"reads": "low"}),
    ],
)
def test_a_fault_goes_both_ways(table, arguments):
    fields = fault_fields(table, HELLO)
    assert fields["arguments"] == pytest.approx(arguments)
    assert fault_table(fields, HELLO) == pytest.approx(table)


def test_a_program_marks_reads_and_stops(loop, monkeypatch):
    monkeypatch.setattr(attached, "connect", loop.connect)
    with attached.attach() as bench:
        bench.mark("here")
        (entry,) = bench.journal()
        assert (entry["do"], entry["fields"]) == ("mark", {"text": "here"})
        bench.stop()
    assert loop.session.controls.is_over
