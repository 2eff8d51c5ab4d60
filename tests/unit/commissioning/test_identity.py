"""What a node says of itself. Right values are those of the EDS files, read by canopen."""

import re

import canopen
import pytest

from device_profiles import PRESSURE_404
from hil_bench.abilities.commissioning.discovery import Sighting
from hil_bench.abilities.commissioning.identity import (
    LONGEST_READING,
    MOST_BYTES,
    NodeDescription,
    describe,
)
from hil_bench.canopen_device.frame import Frame

ABORT = "8000100000000206"


def test_a_node_is_described_as_its_eds_says(open_bench):
    _, network = open_bench()
    eds = canopen.import_od(str(PRESSURE_404))
    found = describe(network, Sighting(2))
    assert found.device_type == eds[0x1000].default
    assert found.product_code == eds[0x1018][2].default
    assert found.revision_number == eds[0x1018][3].default
    assert found.device_name == eds[0x1008].default
    assert found.error_register == 0
    assert found.error_history == ()
    assert found.heartbeat_ms == 0
    assert found.problem == ""


def run_unheard(bench):
    """Let the bench run before anybody listens."""
    bench.run(0.2)
    while bench.bus.recv(0.0):
        pass


@pytest.mark.parametrize("state", ["PRE_OPERATIONAL", "OPERATIONAL"])
def test_a_node_without_heartbeat_is_asked_for_its_state(open_bench, state):
    bench, network = open_bench()
    run_unheard(bench)
    if state == "OPERATIONAL":
        network.start_node(2)
    for _ in range(2):  # with both toggle bits
        assert describe(network, Sighting(2)).nmt_state == state


@pytest.mark.parametrize(
    ("guard_time", "life_time_factor", "asked"), [(0, 0, True), (100, 0, True), (100, 3, False)]
)
def test_guarding_is_not_begun_where_the_node_would_expect_more(
    open_bench, guard_time, life_time_factor, asked
):
    bench, network = open_bench()
    run_unheard(bench)
    bench.nodes["pressure_a"]["0x100C"] = guard_time
    bench.nodes["pressure_a"]["0x100D"] = life_time_factor
    found = describe(network, Sighting(2))
    assert found.nmt_state == ("PRE_OPERATIONAL" if asked else None)
    network.pump(1.0)
    assert found.error_register == 0
    assert bench.nodes["pressure_a"]["0x1001"] == 0


def test_a_node_with_a_heartbeat_is_not_asked(open_bench):
    bench, network = open_bench()
    bench.nodes["pressure_a"]["0x1017"] = 30_000
    run_unheard(bench)
    assert describe(network, Sighting(2)).nmt_state is None
    assert not [each for each in bench.frames if each.frame.is_remote]


def test_the_history_of_errors_is_read_newest_first(open_bench):
    bench, network = open_bench()
    history = bench.bench.nodes[0].object_dictionary
    history.variable(0x1003, 0).value = 2
    history.variable(0x1003, 1).value = 0x8130
    history.variable(0x1003, 2).value = 0x8250
    assert describe(network, Sighting(1)).error_history == (0x8130, 0x8250)


def test_what_a_device_refuses_is_none_and_the_rest_is_read(device, device_network):
    for request in ("4000100000000000", "4018100100000000", "4008100000000000"):
        device.answer(0x605, request, (0x585, ABORT[:2] + request[2:8] + "00000206"))
    device.answer(0x605, "4018100200000000", (0x585, "4318100234120000"))
    found = describe(device_network, Sighting(5))
    assert (found.device_type, found.vendor_id) == (None, None)
    assert found.product_code == 0x1234


def test_of_two_devices_with_one_node_id_nothing_is_read(device, device_network):
    found = describe(device_network, Sighting(5, answers=2))
    assert found.clash
    assert found.problem.startswith("two devices answer, perhaps of two benches on one bus")
    assert (found.device_type, found.vendor_id) == (None, None)
    assert device.received == []


def test_a_device_that_answers_aborts_only_is_said_to_do_so(device, device_network):
    device.refuse_all(5)
    found = describe(device_network, Sighting(5))
    assert found.problem == "every read is answered by an abort"
    assert (found.device_type, found.error_register, found.error_history) == (None, None, None)


def test_a_device_that_falls_silent_is_given_up_after_one_time_out(device_network):
    begin = device_network.now()
    found = describe(device_network, Sighting(5), timeout=0.2)
    assert "0x1000" in found.problem
    assert device_network.now() - begin == pytest.approx(0.2, abs=0.002)


def test_text_from_the_bus_cannot_reach_the_terminal_as_control_characters(device, device_network):
    # "A", ESC, "[" and a zero: expedited, 4 bytes.
    for request, answer in (
        ("4000100000000000", "4300100098010000"),
        *((f"401810{sub:02X}00000000", f"431810{sub:02X}00000000") for sub in range(1, 5)),
        ("4008100000000000", "43081000411B5B00"),
    ):
        device.answer(0x605, request, (0x585, answer))
    assert describe(device_network, Sighting(5)).device_name == r"A\x1b["


def test_the_profile_is_told_in_words():
    expected = {
        0x00000198: "CiA 408, proportional valve",
        0x00080196: "CiA 406, encoder",
        0x000001FF: "CiA 511",
        0: "no standard profile",
        None: None,
    }
    assert {
        device_type: NodeDescription(1, None, clash=False, device_type=device_type).profile
        for device_type in expected
    } == expected


class Endless:
    """Node 5 answers every read by segments, of which none is the last."""

    def __init__(self, latency=0):
        self.latency, self.due = latency, []
        self.requests = 0

    def tick(self, frames, now):
        for frame in frames:
            self.requests += 1
            data = frame.data
            if data[0] == 0x40:
                answer = b"\x40" + data[1:4] + bytes(4)
            else:
                answer = bytes([data[0] & 0x10]) + b"abcdefg"
            if frame.can_id == 0x605 and data[0] != 0x80:
                self.due.append((now + self.latency, Frame(0x585, answer)))
        sent = [frame for time, frame in self.due if time <= now]
        self.due = [(time, frame) for time, frame in self.due if time > now]
        return sent


def test_segments_without_end_are_given_up_and_said(make_network):
    device = Endless()
    found = describe(make_network(device), Sighting(5))
    assert found.problem == (
        f"node 5: cannot read 0x1000: more than {MOST_BYTES} bytes came; it was aborted"
    )
    assert device.requests <= MOST_BYTES // 7 + 3


def test_slow_answers_are_given_up_after_a_while(make_network):
    network = make_network(Endless(latency=400_000_000))  # [ns], each just in time
    begin = network.now()
    assert (
        "node 5: has not answered all in 10 s; 0x1000 was the last"
        in describe(network, Sighting(5)).problem
    )
    assert network.now() - begin <= LONGEST_READING + 0.5


def test_a_long_history_of_slow_answers_is_given_up_too(make_network):
    class Slow(Endless):
        """Each number is 254, and comes just in time."""

        def tick(self, frames, now):
            for frame in frames:
                if frame.can_id == 0x605 and frame.data[0] == 0x40:
                    answer = b"\x43" + frame.data[1:4] + b"\xfe\0\0\0"
                    self.due.append((now + self.latency, Frame(0x585, answer)))
            return super().tick([], now)

    network = make_network(Slow(latency=400_000_000))
    begin = network.now()
    found = describe(network, Sighting(5))
    assert re.fullmatch(
        r"node 5: has not answered all in 10 s; 0x1003\.[0-9A-F]{2} was the last", found.problem
    )
    assert found.vendor_id == 254  # what was read before counts
    assert network.now() - begin <= LONGEST_READING + 0.5
