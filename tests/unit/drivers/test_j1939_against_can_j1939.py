"""The drivers of `hil_drivers.j1939` against `can-j1939`, which is the device, in virtual time."""

import can
import j1939
import pytest
from support.can_j1939 import Clock, TheirEcu, their_dm1

from hil_drivers import Network
from hil_drivers.j1939 import AuxiliaryValve, ClaimState, J1939Port, Name

OURS, THEIRS = 39, 128
MILLISECOND = 1_000_000
COMPONENT = b"ACME*VALVE 3*000123*7*"


class TheirBus(can.BusABC):
    """A bus with their ECU on it, whose time passes while somebody waits in `recv`."""

    def __init__(self, clock):
        self._clock = clock
        self._waiting = []
        self.heard = []
        self.theirs = TheirEcu(send_message=self._take, max_cmdt_packets=16)
        super().__init__("theirs")

    def now(self):
        return self._clock.time()

    def send(self, msg, timeout=None):
        del timeout
        self.heard.append((msg.arbitration_id, bytes(msg.data)))
        self.theirs.notify(msg.arbitration_id, bytearray(msg.data), self.now())

    def recv(self, timeout=None):
        deadline = self._clock.now + round(timeout * 1e9)
        while not self._waiting and self._clock.now < deadline:
            self._clock.now = min(self._clock.now + MILLISECOND, deadline)
            self.theirs.work(self.now())
        return self._waiting.pop(0) if self._waiting else None

    def _take(self, can_id, _is_extended, data):
        self._waiting.append(
            can.Message(arbitration_id=can_id, data=bytes(data), is_extended_id=True)
        )


class Device(j1939.ControllerApplication):
    """A valve driver of theirs."""

    def __init__(self):
        name = j1939.Name(
            identity_number=2, function=129, industry_group=2, arbitrary_address_capable=0
        )
        super().__init__(name, THEIRS)
        self.commands = []
        self.long = []

    def join(self, theirs):
        theirs.add_ca(controller_application=self)
        self.subscribe(self._hear)
        self.subscribe_request(self._answer)
        self.start()

    def _hear(self, _priority, group, source, _time, data):
        if group == 0xFE30:
            self.commands.append((source, bytes(data)))
        elif len(data) > 8:
            self.long.append((group, source, bytes(data)))

    def _answer(self, _source, _destination, group):
        if group == 0xFEEB:
            self.send_pgn(0, 0xFE, 0xEB, 6, list(COMPONENT))


@pytest.fixture
def bus(monkeypatch):
    bus = TheirBus(Clock(monkeypatch))
    bus.device = Device()
    bus.device.join(bus.theirs)
    yield bus
    bus.theirs.stop()
    bus.shutdown()


@pytest.fixture
def port(bus):
    network = Network(bus, clock=bus.now)
    network.pump(1.3)  # they claim after a second
    port = J1939Port(network, Name(identity=7, industry_group=2), OURS)
    port.claim()
    return port


@pytest.fixture
def valve(port):
    return AuxiliaryValve(port, THEIRS)


def test_their_name_is_read(valve):
    valve.setup()

    assert (valve.name.identity, valve.name.function, valve.name.industry_group) == (2, 129, 2)


def test_our_commands_reach_them(bus, port, valve):
    valve.spool_setpoint = -0.5
    port.network.pump(0.25)

    # 0.4 % a bit: 125; state 2 retracts. At once, and after 100 and 200 ms.
    assert bus.device.commands == [(OURS, bytes.fromhex("7d ff f2 ff ff ff ff ff"))] * 3


def test_their_flow_is_read(bus, port, valve):
    # 1 % a bit from -125: 155 is 30 %; state 1 extends.
    bus.device.send_pgn(0, 0xFE, 0x10, 3, [155, 95, 0xF1, 0x1F, 0xC0, 0xFF, 0xFF, 0xFF])
    port.network.pump(0.01)

    assert valve.flow == pytest.approx(0.3)
    assert valve.state.name == "EXTEND"


def test_their_long_answer_comes_by_transport(valve):
    assert valve.component() == ("ACME", "VALVE 3", "000123", "7")


@pytest.mark.parametrize("size", [9, 100, 1785])
def test_our_long_message_reaches_them(bus, port, size):
    data = bytes(number % 253 for number in range(size))
    port.send(0xEF00, data, THEIRS)

    assert bus.device.long == [(0xEF00, OURS, data)]


def test_our_message_to_all_reaches_them(bus, port):
    data = bytes(range(40))
    port.send(0xFF40, data)
    port.network.pump(0.1)

    assert bus.device.long == [(0xFF40, OURS, data)]


def test_their_trouble_codes_are_read(bus, port, valve):
    codes = [{"spn": 1208, "fmi": 3, "oc": 1}, {"spn": 0x7F0AB, "fmi": 31, "oc": 5}]
    their_dm1(bus.device, codes)
    port.network.pump(2.0)

    assert [tuple(code) for code in valve.trouble_codes] == [(1208, 3, 1), (0x7F0AB, 31, 5)]
    assert valve.lamps == {"warning"}


def test_their_claim_with_a_larger_name_is_refused(bus, port):
    other = j1939.Name(identity_number=9, industry_group=2, arbitrary_address_capable=0)
    application = bus.theirs.add_ca(name=other, device_address=OURS)
    application.start()
    port.network.pump(1.5)

    assert port.state is ClaimState.CLAIMED
    assert application.state == application.State.CANNOT_CLAIM


def test_their_claim_with_a_smaller_name_takes_our_address(bus, port):
    other = j1939.Name(identity_number=1, industry_group=2, arbitrary_address_capable=0)
    application = bus.theirs.add_ca(name=other, device_address=OURS)
    application.start()
    port.network.pump(1.5)

    assert port.state is ClaimState.LOST
    assert application.state == application.State.NORMAL
