"""What the page's view of the bus says is wrong."""

from hil_bench.abilities.panel.hub import BusFindings

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
