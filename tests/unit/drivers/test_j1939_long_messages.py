"""Long messages from the J1939 drivers to the bench's devices, and addresses after a lost bus."""

from pathlib import Path

import can
import pytest

from hil_bench import VirtualBench, load_config
from hil_bench.abilities.j1939.protocol.signals import ADDRESS_CLAIMED, split
from hil_drivers import AddressClaimError, BusLostError, DriverTimeoutError, Network
from hil_drivers.j1939 import AuxiliaryValve, ClaimState, J1939Port, Name

EXAMPLE = Path(__file__).parents[3] / "examples" / "j1939.toml"
OURS, VALVE, NOBODY = 39, 128, 77
PROPRIETARY_A, PROPRIETARY_B = 0xEF00, 0xFF40


@pytest.fixture
def bench():
    with VirtualBench(load_config(EXAMPLE)) as bench:
        bench.run(0.3)
        yield bench


@pytest.fixture
def network(bench):
    with Network(bench.bus, clock=bench.now) as network:
        yield network


@pytest.fixture
def port(network):
    port = J1939Port(network, Name(identity=7), OURS)
    port.claim()
    return port


def heard(bench, group):
    """Return the list of what the valve hears of a group: source and data."""
    found = []
    bench.ecus["valve"].ecu.take(group, lambda source, data, _now: found.append((source, data)))
    return found


@pytest.mark.parametrize("size", [9, 14, 15, 113, 1785])
def test_a_long_message_arrives(bench, port, size):
    found, data = heard(bench, PROPRIETARY_A), bytes(number % 253 for number in range(size))
    port.send(PROPRIETARY_A, data, VALVE)
    assert found == [(OURS, data)]


def test_one_to_all_takes_50_ms_a_packet(bench, port):
    found, data = heard(bench, PROPRIETARY_B), bytes(range(30))
    begin = bench.now()
    port.send(PROPRIETARY_B, data)
    # Five packets of seven bytes; the bench hears a frame a tick later.
    assert bench.now() - begin == pytest.approx(0.25, abs=0.002)
    bench.run(0.002)
    assert found == [(OURS, data)]


def test_the_set_point_is_repeated_meanwhile(bench, port):
    with AuxiliaryValve(port, VALVE) as valve:
        valve.spool_setpoint = 0.4
        port.send(PROPRIETARY_B, bytes(70))  # ten packets: 500 ms, the valve's time-out is 300 ms
        assert bench.values["axis1.spool_setpoint"] == 0.4


def test_nobody_answers(bench, port):
    begin = bench.now()
    with pytest.raises(DriverTimeoutError, match="PGN 61184 to address 77, 20 bytes: no answer"):
        port.send(PROPRIETARY_A, bytes(20), NOBODY)
    assert bench.now() - begin == pytest.approx(1.25, abs=0.002)


def test_the_caller_may_have_less_time(bench, port):
    begin = bench.now()
    with pytest.raises(DriverTimeoutError, match=r"20 bytes: not within 0\.5 s"):
        port.send(PROPRIETARY_A, bytes(20), NOBODY, timeout=0.5)
    assert bench.now() - begin == pytest.approx(0.5, abs=0.002)
    port.send(PROPRIETARY_A, bytes(20), VALVE)  # and nothing is left behind


def test_a_lost_address_ends_it(bench, port):
    """A device of a smaller NAME takes ours while the second of three packets waits."""
    claim = can.Message(arbitration_id=0x18EEFF00 | OURS, data=bytes(8), is_extended_id=True)
    ends = bench.now() + 0.06

    def take_away(now):
        if now >= ends and port.state is ClaimState.CLAIMED:
            port.network.deliver(claim)
        return ends

    port.network.add_service(take_away)
    with pytest.raises(AddressClaimError, match="to all, 20 bytes: our address is claimed no more"):
        port.send(PROPRIETARY_B, bytes(20))


class Cable(can.BusABC):
    """A bus that can be cut, and whose frames from others a test gives."""

    def __init__(self):
        super().__init__("cable")
        self.now = 0.0
        self.is_cut = False
        self.sent = []
        self.coming = []

    def send(self, msg, timeout=None):
        del timeout
        if self.is_cut:
            raise can.CanOperationError("Network is down")
        self.sent.append(msg)

    def recv(self, timeout=None):
        if self.is_cut:
            raise can.CanOperationError("Network is down")
        if self.coming:
            return self.coming.pop(0)
        self.now += timeout
        return None

    def claims(self):
        """Return the addresses claimed since the last call."""
        groups = [split(message.arbitration_id) for message in self.sent]
        self.sent.clear()
        return [each.source for each in groups if each.group == ADDRESS_CLAIMED]


@pytest.fixture
def cable():
    cable = Cable()
    yield cable
    cable.shutdown()


@pytest.fixture
def far(cable):
    """Our port on a cable, with its address."""
    port = J1939Port(Network(cable, clock=lambda: cable.now), Name(identity=7), OURS)
    port.claim()
    assert cable.claims() == [OURS]
    return port


ANY_FRAME = can.Message(arbitration_id=0x18FEF100, data=bytes(8), is_extended_id=True)


def error_frame(classes):
    return can.Message(arbitration_id=classes, is_error_frame=True, data=bytes(8))


def test_the_address_is_claimed_again_when_a_lost_bus_is_back(cable, far):
    cable.is_cut = True
    with pytest.raises(BusLostError):
        far.network.pump(0.1)
    cable.is_cut = False
    far.network.pump(0.1)
    assert cable.claims() == []  # nobody is heard yet
    cable.coming.append(ANY_FRAME)
    far.network.pump(0.1)
    assert cable.claims() == [OURS]
    assert far.state is ClaimState.CLAIMING
    far.network.pump(0.25)
    assert far.state is ClaimState.CLAIMED
    cable.coming.append(ANY_FRAME)
    far.network.pump(0.1)
    assert cable.claims() == []  # once


def test_the_address_is_claimed_again_after_bus_off(cable, far):
    # linux/can/error.h: CAN_ERR_BUSOFF, CAN_ERR_RESTARTED.
    cable.coming += [error_frame(0x040)]
    far.network.pump(0.1)
    assert cable.claims() == []
    cable.coming += [error_frame(0x100)]
    far.network.pump(0.1)
    assert cable.claims() == [OURS]


def test_other_error_frames_are_no_loss(cable, far):
    cable.coming += [error_frame(0x004), ANY_FRAME]  # CAN_ERR_CRTL
    far.network.pump(0.1)
    assert cable.claims() == []


def test_without_an_address_nothing_is_claimed(cable):
    port = J1939Port(Network(cable, clock=lambda: cable.now), Name(identity=7), OURS)
    cable.coming += [error_frame(0x040), ANY_FRAME]
    port.network.pump(0.5)
    assert cable.claims() == []
    assert port.state is ClaimState.NONE


def test_a_long_message_does_not_outlive_the_bus(cable, far):
    def cut(now):
        if now > 0.3:
            cable.is_cut = True
        return 0.35

    far.network.add_service(cut)
    with pytest.raises(BusLostError):
        far.send(PROPRIETARY_B, bytes(20))
    cable.is_cut = False
    far.network.remove_service(cut)
    far.network.pump(0.5)
    assert all(split(each.arbitration_id).group != 0xEB00 for each in cable.sent[-2:])
