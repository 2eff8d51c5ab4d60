"""Requests, acknowledgements and cyclic groups of an ECU."""

import pytest
from support.j1939_bus import J1939Bus, make_ecu

TO_ONE, TO_ALL = 0x18EA6410, 0x18EAFF10


@pytest.fixture
def bus():
    ecu = make_ecu(100)
    ecu.provide(0xFF10, lambda: b"\x01\x02", period=50_000_000, priority=3)
    ecu.provide(0xFEEB, lambda: b"MAKE*MODEL*SERIAL*UNIT*")
    ecu.provide(0xEF00, lambda: b"\x05")
    return J1939Bus(ecu)


def test_a_group_is_sent_each_period(bus):
    bus.run(149)

    assert bus.log[1:] == [(time, 0x0CFF1064, "01 02") for time in (0, 50, 100)]


@pytest.mark.parametrize("request_id", [TO_ONE, TO_ALL])
def test_a_short_group_is_sent_to_all_on_request(bus, request_id):
    assert bus.say(request_id, "10 ff 00") == [(0x0CFF1064, "01 02")]


def test_a_group_that_has_a_destination_is_sent_to_who_asks(bus):
    assert bus.say(TO_ONE, "00 ef 00") == [(0x18EF1064, "05")]
    assert bus.say(TO_ALL, "00 ef 00") == [(0x18EFFF64, "05")]


def test_a_long_group_goes_to_who_asks_or_to_all(bus):
    assert bus.say(TO_ONE, "eb fe 00") == [(0x1CEC1064, "10 17 00 04 04 eb fe 00")]
    assert bus.say(TO_ALL, "eb fe 00") == [(0x1CECFF64, "20 17 00 04 ff eb fe 00")]


def test_what_it_does_not_have_is_refused_where_it_alone_is_asked(bus):
    assert bus.say(TO_ONE, "ee fe 00") == [(0x18E8FF64, "01 ff ff ff 10 ee fe 00")]
    assert bus.say(TO_ALL, "ee fe 00") == []


def test_frames_for_others_are_not_taken(bus):
    assert bus.say(0x18EA6510, "ee fe 00") == []


def test_after_a_restart_it_claims_and_begins_anew(bus):
    (ecu,) = bus._ecus
    ecu.stop()
    bus.run(100)
    silent = len(bus.log)
    ecu.start(bus.now)
    bus.run(1)

    assert silent == 2  # claim and the first cyclic group
    assert [can_id for _, can_id, _ in bus.log[silent:]] == [0x18EEFF64, 0x0CFF1064]


def test_a_message_too_long_for_anything_is_refused(bus):
    (ecu,) = bus._ecus
    with pytest.raises(ValueError, match="1786 bytes"):
        ecu.send(0xFF10, bytes(1786))
