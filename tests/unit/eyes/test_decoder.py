"""Frames in words, with the EDS files of the bench and without any."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.sdo_frames import MS, answer, download, heard, request, upload

from device_profiles import ENCODER_406, PRESSURE_404, ROTARY_ENCODER_406, VALVE_408
from hil_bench.abilities.eyes.dbc import write_dbc
from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.known_node import KnownNode, node_of_eds
from hil_bench.abilities.eyes.sight import Service
from hil_bench.abilities.eyes.values import Scale, scale_of, word_text
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import Frame
from hil_bench.units import REVOLUTION, REVOLUTION_PER_MINUTE


def known():
    return [
        KnownNode(1, "valve", load_eds(VALVE_408, 1)),
        KnownNode(2, "pressure", load_eds(PRESSURE_404, 2)),
        KnownNode(4, "position", load_eds(ENCODER_406, 4)),
    ]


def decode(*frames, nodes=None, decoder=None):
    decoder = decoder or Decoder(known() if nodes is None else nodes)
    return [sight for logged in heard(*frames) for sight in decoder.take(logged)]


def texts(*frames, nodes=None):
    return [(s.node, s.name, s.text) for s in decode(*frames, nodes=nodes)]


# 0x2000 of 0x4000 is 50 % (CiA 408); 12345 steps of 1 um, 100 of 0.1 mm/s (the EDS: 1000, 10).
def test_a_frame_is_a_line():
    rows = [
        (Frame(0x201, bytes.fromhex("07000020")),
         ("valve", "RPDO1", "Device control word 0x0007 DHM, Spool set-point 50 %")),
        (Frame(0x181, bytes.fromhex("0F0000F0")),
         ("valve", "TPDO1", "Device status word 0x000F ACTIVE, Spool actual value -25 %")),
        (Frame(0x182, struct.pack("<fB", 103.25, 0)),
         ("pressure", "TPDO1", "AI input process value 1 103.25 bar, AI status 1 0")),
        (Frame(0x184, struct.pack("<ih", 12345, 100)),
         ("position", "TPDO1", "Position value 12.345 mm, Speed value channel 1 10 mm/s")),
        (Frame(0x181, bytes.fromhex("0F00")),
         ("valve", "TPDO1", "[0F 00]  ! 2 bytes, and its mapping has 4")),
        (Frame(0x281, b"\x01"), ("valve", "TPDO2", "[01]  ! its EDS has no such PDO")),
        (Frame(0x181, b"", is_remote=True), ("valve", "TPDO1", "remote request")),
        (Frame(0x285, b"\x01\x02"), ("node 5", "TPDO2", "[01 02]")),
        (Frame(0x000, b"\x01\x04"), ("position", "NMT", "start, node 4")),
        (Frame(0x000, b"\x81\x00"), ("", "NMT", "reset node, all nodes")),
        (Frame(0x000, b"\x81"), ("", "NMT", "! is no NMT message of 2 bytes")),
        (Frame(0x702, b"\x05"), ("pressure", "heartbeat", "OPERATIONAL")),
        (Frame(0x702, b"\x00"), ("pressure", "boot-up", "")),
        (Frame(0x081, bytes.fromhex("3081110000000000")),
         ("valve", "EMCY", "0x8130, life guard or heartbeat error, error register 0x11")),
        (Frame(0x081, bytes.fromhex("0023020100000000")),
         ("valve", "EMCY", ("0x2300, current, CANopen device output side, error register 0x02, "
          "manufacturer 01 00 00 00 00"))),
        (Frame(0x080, b"\x07"), ("a master", "SYNC", "counter 7")),
        (Frame(0x18EEFF00, b"\x01", is_extended=True),
         ("", "29-bit", ("not CANopen, 29-bit identifier 0x18EEFF00; "
          "J1939: PGN 60928 address claimed, from 0"))),
        (Frame(0x7E5, b"\x5e" + bytes(7)), ("", "LSS request", "inquire node-ID")),
        (Frame(0x601, b"\x40"), ("valve", "SDO request", "[40]  ! 1 bytes, 8 are right")),
    ]  # fmt: skip
    assert [texts(frame) for frame, _ in rows] == [[line] for _, line in rows]


def test_a_transfer_is_one_line():
    value = struct.pack("<f", 103.2)
    assert texts(*upload(2, 0x6130, 1, value)) == [
        ("pressure", "SDO", "upload 0x6130.01 AI input process value 1 = 103.2 bar, 1 ms")
    ]
    (sight,) = decode(*download(1, 0x1A00, 1, struct.pack("<I", 0x60410010)))
    assert sight.text.endswith(":= 0x6041.00 (16 bit), 1 ms")
    assert sight.service is Service.SDO


def test_an_abort_names_the_object_and_the_reason():
    frames = request(1, "2F 41 60 00 01"), answer(1, "80 41 60 00 02 00 01 06")
    text = "download 0x6041.00 Device status word, 1 ms  ! aborted, 0x06010002, attempt to write"
    assert texts(*frames)[0][2].startswith(text)


def test_a_value_that_does_not_go_with_the_eds_is_told():
    (line,) = texts(*upload(2, 0x6130, 1, b"\x01\x02"))
    assert line[2].endswith("! has 2 bytes, and is REAL32 of 4 in the EDS")


def test_an_unanswered_request_is_told_after_a_second_and_at_the_end():
    decoder = Decoder(known())
    assert decode(request(1, "40 00 10 00"), decoder=decoder) == []
    (late,) = decoder.expire(1000 * MS)
    assert (late.node, late.problem) == ("valve", "not answered")
    assert decode(request(1, "40 00 10 00"), decoder=decoder) == []
    assert [sight.problem for sight in decoder.finish()] == ["not answered"]


def test_a_pdo_reads_by_the_mapping_that_was_written_on_the_bus():
    pdo = Frame(0x281, b"\x0f\0")
    remapped = [
        *download(1, 0x1800, 1, struct.pack("<I", 0x80000181)),
        *download(1, 0x1A00, 0, b"\0"),
        *download(1, 0x1A00, 1, struct.pack("<I", 0x60410010)),
        *download(1, 0x1A00, 0, b"\1"),
        *download(1, 0x1800, 1, struct.pack("<I", 0x00000281)),
    ]
    assert decode(pdo)[0].readings == ()
    assert decode(*remapped, pdo)[-1].text == "Device status word 0x000F ACTIVE"
    # Reset communication takes it back (CiA 301, 7.3.2.2.1).
    assert decode(*remapped, Frame(0, b"\x82\x01"), pdo)[-1].readings == ()
    # ... unless it was stored: 0x1010 with "save".
    stored = download(1, 0x1010, 1, b"save")
    assert decode(*remapped, *stored, Frame(0, b"\x82\x01"), pdo)[-1].readings != ()


def test_a_unit_that_was_written_counts():
    kilopascal = download(2, 0x6131, 1, struct.pack("<I", 0x03220000))  # CiA 303-2
    frame = Frame(0x182, struct.pack("<fB", 103.25, 0))
    assert "103.25 kPa" in decode(*kilopascal, frame)[-1].text


def test_the_producer_of_sync_is_who_was_told_so():
    frames = [*download(4, 0x1005, 0, struct.pack("<I", 0x40000080)), Frame(0x80)]
    assert decode(*frames)[-1].node == "position"


def test_an_emcy_comes_with_the_identifier_that_was_written():
    frames = [*download(2, 0x1014, 0, struct.pack("<I", 0xA5)), Frame(0xA5, bytes(8))]
    sight = decode(*frames)[-1]
    assert (sight.node, sight.service) == ("pressure", Service.EMCY)


def test_a_pdo_reads_as_its_sender_has_it_though_another_node_takes_it():
    taken = download(1, 0x1400, 1, struct.pack("<I", 0x184))  # RPDO1 of the valve
    sight = decode(*taken, Frame(0x184, struct.pack("<ih", 12345, 100)))[-1]
    assert (sight.node, sight.name) == ("position", "TPDO1")


def test_an_unknown_node_has_the_name_that_it_says():
    frames = [Frame(0x705, b"\0"), *upload(5, 0x1008, 0, b"IO-8"), Frame(0x705, b"\x7f")]
    names = [sight.node for sight in decode(*frames, nodes=[])]
    assert (names[0], names[-1]) == ("node 5", 'node 5 "IO-8"')


def test_the_mapping_of_an_unknown_node_is_learnt():
    frames = [
        *download(5, 0x1800, 1, struct.pack("<I", 0x00000195)),
        *download(5, 0x1A00, 1, struct.pack("<I", 0x64010110)),
        *download(5, 0x1A00, 0, b"\1"),
        Frame(0x195, b"\x34\x12"),
    ]
    sight = decode(*frames, nodes=[])[-1]
    assert (sight.node, sight.name, sight.text) == ("node 5", "TPDO1", "0x6401.01 [34 12]")


def test_terminal_sequences_from_the_bus_are_escaped():
    frames = [*upload(5, 0x1008, 0, b"\x1b[2J"), Frame(0x705, b"\x05")]
    assert all("\x1b" not in s.text + s.node for s in decode(*frames, nodes=[]))


@given(
    st.lists(
        st.builds(
            Frame,
            st.one_of(st.integers(0, 0x7FF), st.sampled_from([0x601, 0x581, 0x181, 0x701, 0])),
            st.binary(max_size=8),
            st.booleans(),
        ),
        max_size=40,
    )
)
def test_no_frames_make_it_stumble(frames):
    decoder = Decoder(known())
    for logged in heard(*frames):
        for sight in decoder.take(logged):
            assert "\n" not in sight.text
    decoder.finish()


def test_a_mapping_of_nonsense_is_read_and_written_as_far_as_it_goes(tmp_path):
    frames = [
        *download(5, 0x1800, 1, struct.pack("<I", 0x00000195)),
        *download(5, 0x1A00, 1, struct.pack("<I", 0x64010110)),
        *download(5, 0x1A00, 2, struct.pack("<I", 0xFFFFFFFF)),
        *download(5, 0x1A00, 3, struct.pack("<I", 0x00000000)),
        *download(5, 0x1A00, 0, b"\xfd"),
        Frame(0x195, bytes(8)),
    ]
    decoder = Decoder()
    assert decode(*frames, decoder=decoder)[-1].problem == "8 bytes, and its mapping has 34"
    assert write_dbc(tmp_path / "x.dbc", decoder) == 1
    assert "x6401_01 : 0|16@1+" in (tmp_path / "x.dbc").read_text()


def test_only_the_pdos_of_the_node_that_was_configured_are_found_anew():
    decoder = Decoder(known())
    before = {address: owners[0].pdo for address, owners in decoder.pdos.items()}
    decode(*download(1, 0x1800, 5, struct.pack("<H", 50)), decoder=decoder)
    changed = {a for a, owners in decoder.pdos.items() if owners[0].pdo is not before[a]}
    assert changed == {0x181, 0x201}  # both of the valve


@pytest.mark.parametrize(
    ("index", "factor"),
    [
        (0x6130, 1.0),
        (0x6148, 1.0),  # of the span: start and end
        (0x6149, 1.0),
        (0x9130, 0.01),
        (0x9148, 0.01),
        (0x9149, 0.01),
        (0x6110, None),  # not of the sensor, but of its scaling
    ],
)
def test_a_measured_value_has_the_unit_and_digits_of_its_channel(index, factor):
    """CiA 404: 0x6131 the unit, 0x6132 the digits of the integers; REAL32 has no digits."""
    objects = load_eds(PRESSURE_404, 2)
    objects.variable(0x6131, 1).value = 0x004E0000  # bar, CiA 303-2
    objects.variable(0x6132, 1).value = 2
    scale = scale_of(objects, index, 1)
    assert (scale and scale.factor) == factor
    assert scale is None or scale.unit.symbol == "bar"


def test_a_word_of_cia_408_says_its_bits_and_no_other():
    expected = {
        (408, 0x6040, 0x0005): "0x0005 DM",  # CiA 408: disable, hold, device mode and reset
        (408, 0x6040, 0x000A): "0x000A HR",
        (408, 0x6040, 0x0000): "0x0000",
        (408, 0x6041, 0x000F): "0x000F ACTIVE",
        (402, 0x6040, 0x000F): "0x000F",
        (402, 0x6041, 0x0237): "0x0237",
    }
    assert {
        (profile, index, value): word_text(profile, index, value)
        for profile, index, value in expected
    } == expected


def test_a_rotary_encoder_shows_revolutions_and_rpm():
    objects = load_eds(ROTARY_ENCODER_406, 4)
    assert scale_of(objects, 0x6004, 0) == Scale(1.0 / 65536, REVOLUTION)
    assert scale_of(objects, 0x6030, 1) == Scale(1.0, REVOLUTION_PER_MINUTE)
    objects.variable(0x6000, 0).value = 0
    objects.variable(0x6001, 0).value = 3600  # not in force: bit 2 of 0x6000 is off
    assert scale_of(objects, 0x6004, 0) == Scale(1.0 / 65536, REVOLUTION)


DCF = """[DeviceInfo]
[DeviceComissioning]
NodeID={made_for}
[1000]
ParameterName=Device type
DataType=7
[1800]
ObjectType=9
[1800sub1]
ParameterName=COB-ID
DataType=7
ParameterValue=0x178
[1A00]
ObjectType=9
[1A00sub0]
ParameterName=Number
DataType=5
ParameterValue=0
"""


@pytest.mark.parametrize(
    ("made_for", "words"),
    [
        (2, ["was made for node-ID 2, and is read for 9; its identifiers may be those of 2"]),
        (9, []),
        (255, []),  # a device that waits for its node-ID
    ],
)
def test_what_a_node_s_file_hides_from_the_decoder_is_a_line(tmp_path, caplog, made_for, words):
    """0x178 is among the identifiers that CiA 301 restricts."""
    path = tmp_path / "motor.dcf"
    path.write_text(DCF.format(made_for=made_for))
    assert node_of_eds(f"9={path}").name == "motor_9"
    error = "12: error: [1800sub1] ParameterValue: is 0x178, which no PDO may have; TPDO1 is off"
    assert caplog.messages == [*(f"{path}: {each}" for each in words), f"{path}:{error}"]
