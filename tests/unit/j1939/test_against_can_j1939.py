"""`can-j1939` on the other side of the bus of the bench's J1939 devices, in virtual time."""

from typing import Any

import j1939
import pytest
from j1939 import controller_application
from support.can_j1939 import Clock, TheirEcu
from support.j1939_bus import MILLISECOND, collect, make_ecu

from hil_bench.abilities.j1939.protocol.diagnostics import Lamp
from hil_bench.abilities.j1939.protocol.signals import Name
from hil_bench.canopen_device.frame import Frame
from hil_drivers.j1939 import Name as DriversName

OURS, THEIRS = 100, 101
PROPRIETARY_A, PROPRIETARY_B = 0xEF00, 0xFF20
MESSAGE = bytes(number % 251 for number in range(1785))


class Pair:
    """One of our ECUs and one of theirs on a bus."""

    def __init__(self, clock, ours, **options):
        self.ours, self._clock = ours, clock
        self._to_us: list[Frame] = []
        self.received: list[tuple[int, int, bytes]] = []
        self.theirs = TheirEcu(send_message=self._take, max_cmdt_packets=16, **options)
        name = j1939.Name(identity_number=2, arbitrary_address_capable=0)
        self.application = self.theirs.add_ca(name=name, device_address=THEIRS)
        self.application.subscribe(self._hear)
        self.application.start()
        ours.start(0)

    def run(self, milliseconds):
        for _ in range(milliseconds):
            self._clock.now += MILLISECOND
            now = self._clock.now
            heard, self._to_us = self._to_us, []
            for frame in heard:
                self.ours.receive(frame, now)
            self.ours.serve(now, self._send)
            self.theirs.work(self._clock.time())

    def _send(self, frame):
        self.theirs.notify(frame.can_id, bytearray(frame.data), self._clock.time())

    def _take(self, can_id, _is_extended, data):
        self._to_us.append(Frame(can_id, bytes(data), is_extended=True))

    def _hear(self, _priority, group, source, _time, data):
        self.received.append((group, source, bytes(data)))


@pytest.fixture
def clock(monkeypatch):
    return Clock(monkeypatch)


@pytest.fixture
def pair(clock):
    pair = Pair(clock, make_ecu(OURS))
    pair.run(1300)
    yield pair
    pair.theirs.stop()


def test_the_names_of_device_and_drivers_are_theirs_too():
    theirs = j1939.Name(
        identity_number=0x12345, manufacturer_code=0x123, ecu_instance=3, function_instance=17,
        function=129, vehicle_system=25, vehicle_system_instance=5, industry_group=2,
        arbitrary_address_capable=1,
    ).value  # fmt: skip
    fields = (0x12345, 0x123, 3, 17, 129, 25, 5, 2, 1)
    assert int(Name(*fields)) == theirs
    assert DriversName(*fields).pack() == theirs.to_bytes(8, "little")
    assert DriversName.parse(theirs.to_bytes(8, "little")) == DriversName(*fields)


def test_both_claim_their_addresses(pair):
    assert pair.ours.address == OURS
    assert pair.application.state == controller_application.ControllerApplication.State.NORMAL


@pytest.mark.parametrize("size", [9, 14, 112, 113, 1785])
def test_a_message_goes_there_by_rts_and_cts(pair, size):
    assert pair.ours.send(PROPRIETARY_A, MESSAGE[:size], THEIRS)
    pair.run(100)

    assert (PROPRIETARY_A, OURS, MESSAGE[:size]) in pair.received


@pytest.mark.parametrize("size", [9, 14, 112, 113, 1785])
def test_a_message_comes_by_rts_and_cts(pair, size):
    taken = collect(pair.ours, [PROPRIETARY_A])

    assert pair.theirs.send_pgn(0, 0xEF, OURS, 6, THEIRS, list(MESSAGE[:size]))
    pair.run(100)

    assert taken == [(PROPRIETARY_A, THEIRS, MESSAGE[:size])]


def test_messages_to_all_go_both_ways(pair):
    taken = collect(pair.ours, [PROPRIETARY_B])

    pair.ours.send(PROPRIETARY_B, MESSAGE[:100])
    pair.theirs.send_pgn(0, 0xFF, 0x20, 6, THEIRS, list(MESSAGE[:50]))
    pair.run(1000)

    assert (PROPRIETARY_B, OURS, MESSAGE[:100]) in pair.received
    assert taken == [(PROPRIETARY_B, THEIRS, MESSAGE[:50])]


def test_their_request_is_answered(pair):
    pair.ours.provide(PROPRIETARY_A, lambda: b"answer")

    pair.application.send_request(0, PROPRIETARY_A, OURS)
    pair.run(5)

    assert (PROPRIETARY_A, OURS, b"answer") in pair.received


def test_our_dm1_is_read_by_them(pair):
    heard: list[Any] = []
    dm1 = j1939.Dm1(pair.application)
    dm1.subscribe(lambda *_: heard.append((dm1.lamp_status, dm1.dtc_dic_list)))

    pair.ours.begin_trouble(1208, 3, Lamp.STOP)
    pair.ours.begin_trouble(0x7F0AB, 31, Lamp.MALFUNCTION)
    pair.run(200)

    lamps, codes = heard[-1]
    assert [(code["spn"], code["fmi"], code["oc"]) for code in codes] == [
        (1208, 3, 1),
        (0x7F0AB, 31, 1),
    ]
    assert lamps == {
        "pl": j1939.DtcLamp.OFF,
        "awl": j1939.DtcLamp.OFF,
        "rsl": j1939.DtcLamp.ON,
        "mil": j1939.DtcLamp.ON,
    }


def test_their_contention_with_a_larger_name_is_lost(clock):
    pair = Pair(clock, make_ecu(THEIRS, identity=1))
    pair.run(1300)

    assert pair.ours.address == THEIRS
    state = controller_application.ControllerApplication.State
    assert pair.application.state == state.CANNOT_CLAIM
    pair.theirs.stop()
