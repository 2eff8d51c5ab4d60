"""Address claim by SAE J1939-81. A smaller NAME wins; the identity is its lowest part."""

import pytest
from support.j1939_bus import J1939Bus, make_ecu

from hil_bench.abilities.j1939.protocol.address_claim import ClaimState
from hil_bench.abilities.j1939.protocol.ecu import Ecu
from hil_bench.abilities.j1939.protocol.signals import Name

NAME_1, NAME_2 = "01 00 00 00 00 00 00 00", "02 00 00 00 00 00 00 00"


def test_a_name_has_its_fields_where_the_standard_puts_them():
    name = Name(
        identity=0x1FFFFF,
        manufacturer=0,
        ecu_instance=7,
        function_instance=0,
        function=0xAB,
        vehicle_system=0x7F,
        vehicle_system_instance=0,
        industry_group=5,
        arbitrary_address=True,
    )

    # bits 0-20, 21-31, 32-34, 35-39, 40-47, 48 reserved, 49-55, 56-59, 60-62, 63
    assert bytes(name).hex(" ") == "ff ff 1f 00 07 ab fe d0"


@pytest.mark.parametrize(("address", "state"), [(127, "claimed"), (128, "claiming")])
def test_an_address_from_128_on_is_used_after_250_ms(address, state):
    ecu = make_ecu(address)
    bus = J1939Bus(ecu)

    assert bus.log == [(0, 0x18EEFF00 | address, NAME_1)]
    assert ecu.state == state
    bus.run(249)
    assert ecu.state == state
    bus.run(1)
    assert ecu.state is ClaimState.CLAIMED


def test_nothing_else_is_sent_before_the_address_is_claimed():
    ecu = make_ecu(200)
    ecu.provide(0xFF10, lambda: b"12345678", period=10_000_000)
    bus = J1939Bus(ecu)

    bus.run(300)

    assert not ecu.send(0xFF11, b"") or bus.sent(0xFF10)[0][0] == 250
    assert bus.sent(0xFF10)[0][0] == 250


def test_the_smaller_name_keeps_the_address_and_says_so():
    ecu = make_ecu(128, identity=1)
    bus = J1939Bus(ecu)

    assert bus.say(0x18EEFF80, NAME_2) == [(0x18EEFF80, NAME_1)]
    assert ecu.address == 128


def test_the_larger_name_cannot_claim_and_says_so_after_a_delay():
    ecu = make_ecu(128, identity=2)
    bus = J1939Bus(ecu)

    assert bus.say(0x18EEFF80, NAME_1) == []
    bus.run(10)

    # two units of 0.6 ms, so in the second tick
    assert bus.log[1:] == [(2, 0x18EEFFFE, NAME_2)]
    assert ecu.state is ClaimState.CANNOT
    assert not ecu.send(0xFF10, b"1")


def test_a_device_that_may_move_takes_a_free_address():
    ecu = make_ecu(130, identity=2, arbitrary=True)
    bus = J1939Bus(ecu)

    bus.say(0x18EEFF80, NAME_1)  # 128 is taken
    bus.say(0x18EEFF82, NAME_1)  # and now 130

    assert ecu.address == 129
    assert bus.log[-1][1] == 0x18EEFF81


def test_a_bus_full_of_others_leaves_no_address():
    ecu = make_ecu(128, identity=2, arbitrary=True)
    bus = J1939Bus(ecu)

    for address in range(247, 127, -1):
        bus.say(0x18EEFF00 | address, NAME_1)

    assert ecu.state is ClaimState.CANNOT


def test_the_same_name_twice_is_a_contention_that_both_lose():
    first, second = make_ecu(128), make_ecu(128)
    bus = J1939Bus(first, second)

    bus.run(300)

    assert first.state is second.state is ClaimState.CANNOT


@pytest.mark.parametrize("destination", [0xFF, 0x80])
def test_a_request_for_the_address_is_answered(destination):
    bus = J1939Bus(make_ecu(128))

    request = 0x18EA00FE | destination << 8  # from a device that has no address

    assert bus.say(request, "00 ee 00") == [(0x18EEFF80, NAME_1)]


def test_a_request_is_answered_by_cannot_claim_too():
    ecu = make_ecu(128, identity=2)
    bus = J1939Bus(ecu)
    bus.say(0x18EEFF80, NAME_1)
    bus.run(10)

    assert bus.say(0x18EAFF10, "00 ee 00") == []
    bus.run(5)

    assert bus.log[-1] == (12, 0x18EEFFFE, NAME_2)


def test_a_commanded_address_is_obeyed_by_whom_it_means():
    ecu, other = make_ecu(128, identity=1), make_ecu(129, identity=2)
    bus = J1939Bus(ecu, other)
    bus.run(300)

    bus.say(0x1CECFF10, "20 09 00 02 ff d8 fe 00")
    bus.say(0x1CEBFF10, "01 01 00 00 00 00 00 00")
    answer = bus.say(0x1CEBFF10, "02 00 c8 ff ff ff ff ff")

    assert answer == [(0x18EEFFC8, NAME_1)]
    assert (ecu.address, other.address) == (200, 129)


def test_a_foreign_frame_from_the_own_address_is_an_address_violation():
    ecu = make_ecu(100)
    bus = J1939Bus(ecu)

    answers = bus.say(0x18FF1064, "00") + bus.say(0x18FF1064, "00")

    # one claim in five seconds, and a trouble code of SPN 2000 + address, FMI 31
    assert [can_id for can_id, _ in answers] == [0x18EEFF64, 0x18FECA64]
    assert ecu.diagnostics.active == [(2100, 31)]


@pytest.mark.parametrize("data", ["", "00 ee", "01 02 03 04 05 06 07", "00" * 8])
def test_short_and_strange_frames_change_nothing(data):
    ecu = make_ecu(100)
    bus = J1939Bus(ecu)

    for can_id in (0x18EAFF10, 0x18E8FF10, 0x1CECFF10, 0x1CEBFF10, 0x1CEC6410, 0x1CEB6410):
        bus.say(can_id, data)

    assert ecu.address == 100


def test_without_power_nothing_is_said():
    ecu = Ecu(Name(), 100)

    sent = []
    ecu.serve(0, sent.append)

    assert not sent
