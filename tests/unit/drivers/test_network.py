"""The network: what it sends, what it hands on, and how it waits; all in virtual time."""

import can
import pytest

from hil_drivers import BusLostError, DriverTimeoutError, Network, NmtState
from hil_drivers.network import BACKLOG


class Listener:
    """Keeps what it is told."""

    def __init__(self):
        self.heard = []

    def receive(self, data, now):
        self.heard.append((data, now))
        return len(data) == 2


@pytest.fixture
def listener(network):
    listener = Listener()
    network.subscribe(0x181, listener.receive)
    return listener


def test_sync_is_an_empty_frame_on_080(network, expected_protocol):
    with expected_protocol([("080#", None)]):
        network.sync()


@pytest.mark.parametrize(
    ("command", "frame"),
    [
        # Command specifiers of CiA 301: start 1, stop 2, enter PRE-OPERATIONAL 128.
        (lambda network: network.start_node(5), "000#01.05"),
        (lambda network: network.start_node(), "000#01.00"),
        (lambda network: network.stop_node(), "000#02.00"),
        (lambda network: network.enter_pre_operational(), "000#80.00"),
        (lambda network: network.command_reset_node(), "000#81.00"),
    ],
)
def test_nmt_commands(network, expected_protocol, command, frame):
    with expected_protocol([(frame, None)]):
        command(network)


@pytest.mark.parametrize(
    ("reset", "frame"), [("reset_node", "000#81.05"), ("reset_communication", "000#82.05")]
)
def test_reset_waits_for_the_boot_up(network, encoder_eds, expected_protocol, reset, frame):
    network.add_node(5, encoder_eds)
    with expected_protocol([(frame, "705#00")]):
        getattr(network, reset)(5)
    assert network.nodes[5].nmt_state is NmtState.PRE_OPERATIONAL


def test_reset_of_a_silent_node_times_out(network, encoder_eds, bus):
    network.add_node(5, encoder_eds)
    with pytest.raises(DriverTimeoutError, match=r"node 5: boot-up after reset: not within 2 s"):
        network.reset_node(5)
    assert bus.now() == pytest.approx(102.0)  # the bus's clock starts at 100 s


def test_an_old_boot_up_does_not_end_the_wait_for_the_next(network, encoder_eds, bus):
    network.add_node(5, encoder_eds)
    bus.play("705#00")
    network.pump()
    with pytest.raises(DriverTimeoutError):
        network.reset_node(5, timeout=0.1)


def test_a_frame_is_told_with_its_time_of_reception(network, bus, listener):
    bus.play("181#01.02")
    network.pump(0.5)
    assert listener.heard == [(b"\x01\x02", 100.0)]
    assert bus.now() == pytest.approx(100.5)


def test_each_listener_of_a_cob_id_is_told_once(network, bus, listener):
    other = Listener()
    network.subscribe(0x181, other.receive)
    network.subscribe(0x181, other.receive)
    bus.play("181#01.02")
    network.pump()
    assert len(listener.heard) == len(other.heard) == 1


def test_what_is_not_a_canopen_data_frame_is_counted_and_dropped(network, bus, listener):
    bus.play("181#R", "00000181#01.02")
    bus.waiting.append(can.Message(arbitration_id=0x181, is_extended_id=False, is_error_frame=True))
    bus.waiting.append(
        can.Message(arbitration_id=0x181, is_extended_id=False, is_fd=True, data=bytes(2))
    )
    network.pump()
    assert listener.heard == []
    assert (network.counters.received, network.counters.ignored) == (4, 4)


@pytest.mark.usefixtures("listener")
def test_unknown_and_malformed_frames_are_counted(network, bus):
    bus.play("182#01.02", "181#01.02.03", "181#")
    network.pump()
    assert (network.counters.unknown, network.counters.malformed) == (1, 2)


def test_a_flood_does_not_keep_the_caller(network, bus, listener):
    bus.play(*["181#01.02"] * (BACKLOG + 10))
    network.pump()
    assert len(listener.heard) == BACKLOG


def test_wait_until_looks_once_more_before_it_gives_up(network, bus, listener):
    # The process was held up: the frame is there, but the time is over.
    bus.play("181#01.02")
    network.wait_until(lambda: listener.heard, 0.0, "a frame")


def test_wait_until_names_what_did_not_come(network):
    with pytest.raises(DriverTimeoutError, match=r"a frame: not within 0\.25 s"):
        network.wait_until(lambda: False, 0.25, "a frame")


def test_heartbeat_begins_with_a_boot_up_and_keeps_its_period(network, bus):
    network.start_heartbeat(127, 0.1)
    network.pump(0.35)
    # Boot-up at once, then OPERATIONAL (5) at 0, 100, 200 and 300 ms.
    assert bus.sent == ["77F#00", *["77F#05"] * 4]


def test_a_late_caller_sends_one_heartbeat_and_no_burst(network, bus):
    network.start_heartbeat(127, 0.1)
    network.pump(0.05)
    bus.time += 10.0
    network.pump(0.05)
    assert bus.sent == ["77F#00", "77F#05", "77F#05"]


def test_no_heartbeat_after_it_was_stopped(network, bus):
    network.start_heartbeat(127, 0.1)
    network.stop_heartbeat()
    network.pump(1.0)
    assert bus.sent == ["77F#00"]


@pytest.mark.parametrize(("node_id", "period"), [(0, 0.1), (128, 0.1), (5, 0.1), (1, 0.0)])
def test_a_heartbeat_that_makes_no_sense_is_refused(network, encoder_eds, node_id, period):
    network.add_node(5, encoder_eds)
    with pytest.raises(ValueError, match="is right"):
        network.start_heartbeat(node_id, period)


def test_wait_for_state_takes_the_heartbeats_word(network, encoder_eds, bus):
    network.add_node(5, encoder_eds)
    network.start_node(5)
    with pytest.raises(DriverTimeoutError, match="node 5: heartbeat in NMT state OPERATIONAL"):
        network.wait_for_state([5], NmtState.OPERATIONAL, 0.1)
    bus.play("705#05")
    network.wait_for_state([5], NmtState.OPERATIONAL, 0.1)


def test_drivers_of_one_device_share_its_node(network, encoder_eds, valve_eds):
    assert network.add_node(5, encoder_eds) is network.add_node(5, encoder_eds)
    with pytest.raises(ValueError, match="needs another node-ID"):
        network.add_node(5, valve_eds)


@pytest.mark.parametrize(
    ("failure", "reason"),
    [
        (can.CanOperationError("Transmit buffer full\nmore"), "Transmit buffer full"),
        (OSError(19, "No such device"), r"\[Errno 19\] No such device"),
    ],
)
def test_a_bus_that_fails_is_lost_in_one_line(failure, reason, bus, monkeypatch):
    def fail(*_):
        raise failure

    monkeypatch.setattr(bus, "send", fail)
    monkeypatch.setattr(bus, "recv", fail)
    network = Network(bus, clock=bus.now)
    with pytest.raises(BusLostError, match=f"^cannot send on transcript: {reason}$"):
        network.sync()
    with pytest.raises(BusLostError, match=f"^cannot receive on transcript: {reason}$"):
        network.pump(0.1)


def test_a_closed_network_listens_no_longer(bus, encoder_eds):
    with Network(bus, clock=bus.now) as network:
        node = network.add_node(5, encoder_eds)
    bus.play("705#05")
    network.pump()
    assert node.nmt_state is None


def test_an_nmt_command_to_no_node_is_refused(network, bus):
    with pytest.raises(ValueError, match="node-ID 128"):
        network.start_node(128)
    assert bus.sent == []
