"""J1939 on a bus, in lines: who sends what, long messages as one line, and what failed."""

from pathlib import Path

import pytest

from hil_bench import load_config
from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.known_ecu import ecus_of
from hil_bench.abilities.eyes.known_node import nodes_of
from hil_bench.abilities.eyes.sight import Service
from hil_bench.abilities.eyes.verbs.sight_lines import is_problem
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import LoggedFrame

CONFIG = load_config(Path(__file__).parents[3] / "examples" / "j1939.toml")
MS = 1_000_000
JOYSTICK_NAME = int(next(ecu.identity for ecu in CONFIG.ecus if ecu.name == "joystick"))
DM1_BAM = [
    (0x1CECFF80, "20 0A 00 02 FF CA FE 00"),  # 10 bytes in two packets: DM1
    (0x1CEBFF80, "01 04 FF 64 00 03 01 65"),
    (0x1CEBFF80, "02 00 04 01 FF FF FF FF"),
]
COMPONENT = [
    (0x18EA8027, "EB FE 00"),
    (0x1CEC2780, "10 09 00 02 02 EB FE 00"),
    (0x1CEC8027, "11 02 01 FF FF EB FE 00"),
    (0x1CEB2780, "01 41 2A 42 2A 43 2A 44"),
    (0x1CEB2780, "02 2A 2A FF FF FF FF FF"),
    (0x1CEC8027, "13 09 00 02 FF EB FE 00"),
]


def lines(*frames, known=True, step=1, end=0):
    """Return sender, PGN and text of each line; frames come each millisecond."""
    decoder = Decoder(*((nodes_of(CONFIG), ecus_of(CONFIG)) if known else ()))
    sights = []
    for number, (can_id, data) in enumerate(frames):
        frame = Frame(can_id, bytes.fromhex(data), is_extended=can_id > 0x7FF)
        sights += decoder.take(LoggedFrame(frame, number * step * MS, None))
    sights += decoder.expire(end * MS) if end else decoder.finish()
    return [(sight.node, sight.name, sight.text) for sight in sights]


def test_a_known_device_has_its_name_and_its_signals():
    # 400 (0x190) from bit 6 are 40 %; left is 1, right 0, and the button is not available.
    ((node, name, text),) = lines((0x0CFDD613, "04 64 FF FF FF FF FF FF"))
    assert (node, name) == ("joystick", "PGN 64982")
    assert text == (
        "BJM1, basic joystick: x 40 %, x_neutral 0, x_left 1, x_right 0, button_1 not available"
    )


def test_indicators_are_no_values():
    ((_, _, text),) = lines((0x0CFDD613, "80 FF 00 00 00 80 00 00"))
    # 10 bits 1022: error; of two bits 2 is.
    assert "x error, x_neutral 0" in text
    assert "button_1 error" in text


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ("7D FF F1", "command: extend 50 %"),  # 0.4 % a bit
        ("7D FF F2", "command: retract 50 %"),
        ("00 FF F0", "command: block 0 %"),
        ("00 FF F7", "command: reserved 0 %"),
        ("00", "command [00]"),
    ],
)
def test_a_valve_command_is_read(data, words):
    assert lines((0x0CFE3027, data)) == [("address 39", "PGN 65072", f"auxiliary valve 0 {words}")]


def test_a_valve_says_why_it_obeys_nothing():
    ((node, _, text),) = lines((0x0CFE1080, "7D 7D 30 1F C5 FF FF FF"))
    assert (node, text) == (
        "valve",
        "auxiliary valve 0 estimated flow: block, flow 0 %, obeys no command: time-out",
    )


def test_a_message_to_all_is_one_line():
    ((node, name, text),) = lines(*DM1_BAM, step=50)
    assert (node, name) == ("valve", "PGN 65226")
    assert text == (
        "DM1, active trouble codes, 10 bytes by BAM in 100 ms: "
        "lamp warning, SPN 100 FMI 3, SPN 101 FMI 4"
    )


def test_a_transfer_to_one_is_one_line():
    assert lines(*COMPONENT) == [
        ("address 39", "PGN 59904", "request to valve: PGN 65259 component identification"),
        (
            "valve",
            "PGN 65259",
            "component identification to address 39, 9 bytes by RTS and CTS in 4 ms: 'A*B*C*D**'",
        ),
    ]


@pytest.mark.parametrize(
    ("frames", "problem"),
    [
        (COMPONENT[1:2], "not answered, no CTS of the receiver (T3)"),
        (COMPONENT[1:4], "not complete, 1 of 2 packets, no packet after number 1 (T1)"),
        (COMPONENT[1:5], "not acknowledged, no end of message of the receiver (T3)"),
        (
            [*COMPONENT[1:3], COMPONENT[5]],
            "not complete, 0 of 2 packets, no packet after the CTS (T2)",
        ),
        (
            [*COMPONENT[1:3], (0x1CEC8027, "FF 03 FF FF FF EB FE 00")],
            "aborted by 39, reason 3 timeout: no packet after the CTS (T2)",
        ),
        (DM1_BAM[:2], "not complete, 1 of 2 packets, no packet after number 1 (T1)"),
        ([DM1_BAM[0], DM1_BAM[2]], "not complete, 1 of 2 packets, packet 2 came in place of 1"),
    ],
)
def test_a_transfer_that_fails_is_a_problem(frames, problem):
    ((_, _, text),) = lines(*frames, end=2000)
    assert text.endswith(f"! {problem}")


def bam(size, packets, step):
    """Return the lines of a BAM of PGN 65507, its frames `step` ms apart."""
    head = f"20 {size:02X} 00 {packets:02X} FF E3 FE 00"
    data = [f"{n:02X} 01 02 03 04 05 06 07" for n in range(1, packets + 1)]
    return lines((0x1CECFF80, head), *((0x1CEBFF80, each) for each in data), known=False, step=step)


@pytest.mark.parametrize(
    ("step", "problem"),
    [
        (5, "5 ms between its packets, 10 ms to 200 ms are right"),
        (10, ""),  # from here on by ISO 11783-3
        (200, ""),  # up to here by J1939-21
        (300, "300 ms between its packets, 10 ms to 200 ms are right"),
    ],
)
def test_a_message_to_all_has_a_pace(step, problem):
    ((_, _, text),) = bam(28, 4, step)
    assert text.partition("  ! ")[2] == problem


@pytest.mark.parametrize(
    ("can_id", "head", "problem"),
    [
        (0x1CECFF80, "20 0A 00 03", "announced with 3 packets, 2 are right"),
        (0x1CECFF80, "10 0A 00 02", "RTS to all"),
        (0x1CEC2780, "20 0A 00 02", "BAM to one address"),
        (0x1CEC2780, "10 00 08 25", "announced with 2048 bytes, 1785 at most are right"),
    ],
)
def test_an_announcement_that_contradicts_itself_is_a_problem(can_id, head, problem):
    found = lines((can_id, f"{head} FF CA FE 00"))
    assert found[0][2].endswith(f"! {problem}")


def test_a_receiver_that_says_wait_is_awaited():
    """CTS of 0 packets: then a CTS is due, by the receiver (T4)."""
    hold = (0x1CEC8027, "11 00 FF FF FF EB FE 00")
    ((_, _, text),) = lines(COMPONENT[1], hold, end=2000)
    assert text.endswith("no CTS after the one that says wait (T4)")
    assert lines(COMPONENT[1], hold, *COMPONENT[2:])[-1][2].endswith("'A*B*C*D**'")


def test_packets_that_are_asked_for_again_are_no_problem():
    again = [*COMPONENT[1:3], COMPONENT[4], (0x1CEC8027, "11 02 01 FF FF EB FE 00")]
    assert lines(*again, *COMPONENT[3:])[-1][2].endswith("'A*B*C*D**'")


@pytest.mark.parametrize(
    ("can_id", "data", "text"),
    [
        # engine speed: 0.125 rpm a bit in bytes 4 and 5; torque: 1 % a bit from -125 %
        (
            0x0CF00400,
            "F0 FF 91 80 25",
            "actual torque (SPN 513) 20 %, engine speed (SPN 190) 1200 rpm",
        ),
        # oil: 1/32 °C a bit from -273 °C in bytes 3 and 4; coolant: 1 °C a bit from -40 °C
        (
            0x18FEEE00,
            "82 FF 60 2D",
            "coolant temperature (SPN 110) 90 °C, oil temperature (SPN 175) 90 °C",
        ),
        (0x18FEF10B, "FF 00 FE", "wheel-based speed (SPN 84) error"),  # the high byte says so
        (0x18FEF10B, "FF FE 0A", "wheel-based speed (SPN 84) 10.9922 km/h"),  # the low one does not
    ],
)
def test_signals_of_the_standard_are_read(can_id, data, text):
    claim = (0x18EEFF00, "01 00 00 00 00 00 00 00")
    frame = (can_id, f"{data} FF FF FF FF FF FF"[: 3 * 8 - 1])
    assert lines(claim, frame, known=False)[1][2].partition(": ")[2] == text


def test_a_new_message_ends_the_one_before():
    texts = [text for _, _, text in lines(*DM1_BAM[:2], *DM1_BAM)]
    assert len(texts) == 2
    assert texts[0].endswith("no packet after number 1 (T1), then a new one")
    assert texts[1].endswith("SPN 101 FMI 4")


def test_a_device_keeps_its_name_at_another_address():
    name = JOYSTICK_NAME.to_bytes(8, "little").hex()
    found = lines((0x18EEFF85, name), (0x0CFDD685, "FF"), (0x0CFDD613, "FF"))
    assert [node for node, _, _ in found] == ["joystick", "joystick", "address 19"]


def test_a_bus_that_speaks_j1939_is_told_by_a_claim():
    frame = (0x0CF00400, "00 11")
    assert lines(frame, known=False)[0][1] == "29-bit"
    after = lines((0x18EEFF00, "00 " * 8), frame, known=False)[1]
    # SPN 512 is byte 2: 1 % a bit from -125 %; the rest of the message is not there
    words = "EEC1, engine speed: demanded torque (SPN 512) -108 %"
    assert after == ("address 0", "PGN 61444", words)


def test_parts_of_no_transfer_are_lines_of_their_own():
    found = lines(COMPONENT[3], COMPONENT[2])
    assert [name for _, name, _ in found] == ["PGN 60160", "PGN 60416"]


def test_canopen_frames_are_read_beside_them():
    found = lines((0x704, "7F"), (0x0CFDD613, "FF"), (0x184, "00"))
    assert [name for _, name, _ in found] == ["heartbeat", "PGN 64982", "TPDO1"]


def test_such_lines_are_chosen_by_their_service():
    decoder = Decoder(ecus=ecus_of(CONFIG))
    frame = Frame(0x0CFDD613, b"\xff", is_extended=True)
    (sight,) = decoder.take(LoggedFrame(frame, 0, None))
    assert sight.service is Service.J1939
    assert decoder.ecus == ["valve", "joystick", "sensors"]


def test_a_trouble_code_is_a_problem():
    decoder = Decoder(ecus=ecus_of(CONFIG))

    def sight(data):
        frame = Frame(0x18FECA80, bytes.fromhex(data), is_extended=True)
        return decoder.take(LoggedFrame(frame, 0, None))[0]

    assert is_problem(sight("04 FF 64 00 03 01 FF FF"))
    assert not is_problem(sight("00 FF 00 00 00 00 FF FF"))
