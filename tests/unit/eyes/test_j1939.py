"""29-bit frames as J1939 reads them.

EEC1 of an engine is 0x0CF00400: priority 3, PGN 61444, source 0 (any J1939 introduction). A NAME is
the identity number in bits 0 to 20, the manufacturer in 21 to 31, the function in 40 to 47. SPN 190
is the engine speed; 0x40 in the first byte of DM1 is the malfunction indicator lamp.
"""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.abilities.eyes.j1939 import _valve_command, describe
from hil_bench.abilities.j1939.protocol.signals import GLOBAL, split

NAME = (0x12345 | 0x123 << 21 | 0x81 << 40).to_bytes(8, "little")


def test_the_parts_of_an_identifier():
    expected = {
        0x0CF00400: (3, 61444, 0x00, GLOBAL),
        0x18EEFF21: (6, 60928, 0x21, GLOBAL),
        0x18EA2103: (6, 59904, 0x03, 0x21),
        0x1CECFF00: (7, 60416, 0x00, GLOBAL),
        0x18FECA00: (6, 65226, 0x00, GLOBAL),
        0x19F00421: (6, 1 << 16 | 61444, 0x21, GLOBAL),  # data page 1
    }
    assert {can_id: split(can_id) for can_id in expected} == expected


def test_a_frame_in_words():
    expected = {
        (0x0CF00400, "0011"): "PGN 61444 EEC1, engine speed, from 0",
        (0x0CFE3203, "00"): "PGN 65074 auxiliary valve 2 command, from 3",
        (0x18FE1103, "00"): "PGN 65041 auxiliary valve 1 estimated flow, from 3",
        (0x18FE2F03, "00"): "PGN 65071 auxiliary valve 15 measured flow, from 3",
        (0x0CFE4003, "00"): "PGN 65088, from 3",
        (0x18E8FF21, "01FFFFFF0340F0"): "PGN 59392 acknowledgement, from 33",  # cut short
        (0x18FF1221, ""): "PGN 65298 proprietary B, from 33",
        (0x18EF2103, ""): "PGN 61184 proprietary A, from 3 to 33",
        (0x10011223, ""): "PGN 256, from 35 to 18",
        (0x18EAFFFE, "00EE00"): "PGN 59904 request, from none: PGN 60928 address claimed",
        (
            0x18EEFF21,
            NAME.hex(),
        ): "PGN 60928 address claimed, from 33: manufacturer 291, function 129, identity 74565",
        (
            0x1CECFF00,
            "200D0002FFCAFE00",
        ): "PGN 60416 TP.CM, transport connection, from 0: BAM, 13 bytes in 2 packets, "
        "PGN 65226 DM1, active trouble codes",
        (
            0x1CEC2100,
            "110201FFFFCAFE00",
        ): "PGN 60416 TP.CM, transport connection, from 0 to 33: CTS, 2 packets from 1, "
        "PGN 65226 DM1, active trouble codes",
        (
            0x18FECA00,
            "40FFBE000201FFFF",
        ): "PGN 65226 DM1, active trouble codes, from 0: lamp malfunction, SPN 190 FMI 2",
        (
            0x18FECA00,
            "00FF00000000FFFF",
        ): "PGN 65226 DM1, active trouble codes, from 0: no lamp, no trouble code",
        (0x18E8FF21, "01FFFFFF0340F000"): "PGN 59392 acknowledgement, from 33: refused, PGN 61504",
    }
    assert {
        (can_id, data): describe(can_id, bytes.fromhex(data)) for can_id, data in expected
    } == expected


@pytest.mark.parametrize(
    ("group", "name"),
    [
        (65227, "DM2"),
        (65228, "DM3"),
        (65240, "commanded address"),
        (65242, "software identification"),
        (65253, "engine hours"),
        (65259, "component identification"),
        (65260, "vehicle identification"),
        (65262, "ET1"),
        (65263, "EFL/P1"),
        (65265, "CCVS"),
        (65266, "LFE"),
        (65269, "AMB"),
        (65271, "VEP1"),
    ],
)
def test_groups_have_the_names_of_the_standard(group, name):
    """SAE J1939-71 and -73 number them in decimal."""
    assert describe(group << 8 | 3, b"").startswith(f"PGN {group} {name}")


@given(st.integers(0, (1 << 29) - 1), st.binary(max_size=8))
def test_any_frame_has_words_of_one_line(can_id, data):
    text = describe(can_id, data)
    assert text.startswith("PGN ")
    assert "\n" not in text


def test_a_cut_valve_command_has_no_words():
    assert _valve_command(b"\0\0") == ""
    assert _valve_command(b"\0\0\x01") != ""
