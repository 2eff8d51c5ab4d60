"""DM1, DM2 and DM3 by SAE J1939-73: two bytes of lamps, then four a code.

SPN 1208 (0x4B8), FMI 3, occurrence 10 by its layout: the low bytes B8 04, bits 17 to 19 of the SPN
above the FMI in 03, and 0A.
"""

import pytest
from support.j1939_bus import J1939Bus, make_ecu

from hil_bench.abilities.j1939.protocol.diagnostics import MOST_CODES, Lamp

NONE = "00 ff 00 00 00 00 ff ff"


@pytest.fixture
def ecu():
    return make_ecu(100)


@pytest.fixture
def bus(ecu):
    return J1939Bus(ecu)


def test_a_code_is_reported_at_once_and_each_second(bus, ecu):
    for _ in range(10):
        ecu.begin_trouble(1208, 3, Lamp.WARNING)
        ecu.end_trouble(1208, 3)
        bus.run(1001)

    sent = bus.sent(0xFECA)
    assert sent[0] == (1, "04 ff b8 04 03 01 ff ff")  # amber warning lamp: bits 4-3
    assert "04 ff b8 04 03 0a ff ff" in [data for _, data in sent]  # the tenth time


def test_a_code_that_lasts_is_repeated_each_second(bus, ecu):
    ecu.begin_trouble(1208, 3, None)
    bus.run(2500)

    assert bus.sent(0xFECA) == [(time, "00 ff b8 04 03 01 ff ff") for time in (1, 1001, 2001)]


def test_the_end_of_a_code_is_reported_once(bus, ecu):
    ecu.begin_trouble(1208, 3)
    bus.run(1500)
    ecu.end_trouble(1208, 3)
    bus.run(3000)

    assert bus.sent(0xFECA)[2:] == [(1501, NONE)]


def test_a_short_code_takes_two_messages(bus, ecu):
    """It begins at 0 and is active for a second at least."""
    ecu.begin_trouble(1208, 3, Lamp.WARNING)
    bus.run(500)
    ecu.end_trouble(1208, 3)
    bus.run(3000)

    assert bus.sent(0xFECA) == [(1, "04 ff b8 04 03 01 ff ff"), (1000, NONE)]


def test_a_code_ends_with_its_last_reason(bus, ecu):
    ecu.begin_trouble(1208, 3)
    ecu.begin_trouble(1208, 3)
    bus.run(1500)
    ecu.end_trouble(1208, 3)
    bus.run(300)
    ecu.end_trouble(1208, 3)
    bus.run(3000)

    assert [time for time, _ in bus.sent(0xFECA)] == [1, 1001, 1801]


def test_a_high_spn_has_its_upper_bits_beside_the_fmi(bus, ecu):
    ecu.begin_trouble(0x7F0AB, 31, Lamp.STOP)
    bus.run(1)

    assert bus.sent(0xFECA)[0][1] == "10 ff ab f0 ff 01 ff ff"


def test_two_codes_go_by_transport_to_all(bus, ecu):
    ecu.begin_trouble(1208, 3, Lamp.PROTECT)
    ecu.begin_trouble(1907, 9, Lamp.MALFUNCTION)  # 0x773
    bus.run(200)

    assert bus.sent(0xEC00)[0][1] == "20 0a 00 02 ff ca fe 00"
    assert [data for _, data in bus.sent(0xEB00)] == [
        "01 41 ff b8 04 03 01 73",
        "02 07 09 01 ff ff ff ff",
    ]


def test_previous_codes_are_asked_for_and_cleared(bus, ecu):
    ecu.begin_trouble(1208, 3)
    ecu.end_trouble(1208, 3)
    bus.run(1500)

    assert bus.say(0x18EA6410, "cb fe 00") == [(0x18FECB64, "00 ff b8 04 03 01 ff ff")]
    assert bus.say(0x18EA6410, "cc fe 00") == [(0x18E8FF64, "00 ff ff ff 10 cc fe 00")]
    assert bus.say(0x18EA6410, "cb fe 00") == [(0x18FECB64, NONE)]


def test_without_a_code_dm1_comes_on_request_alone(bus):
    bus.run(3000)

    assert bus.sent(0xFECA) == []
    assert bus.say(0x18EAFF10, "ca fe 00") == [(0x18FECA64, NONE)]


def test_codes_are_bounded(ecu):
    for spn in range(100):
        ecu.begin_trouble(spn, 1)

    assert len(ecu.diagnostics.active) == MOST_CODES
