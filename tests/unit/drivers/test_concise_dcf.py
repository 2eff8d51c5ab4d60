"""Concise DCF (CiA 302-3, 0x1F22): its bytes, also beside those of another maker's tool."""

import struct

import pytest
from support.dcfgen import run_dcfgen

from device_profiles import VALVE_408
from hil_drivers import ConciseDcfError, EdsError
from hil_drivers.concise_dcf import (
    ConciseEntry,
    convert_dcf,
    order_writes,
    pack_concise_dcf,
    parse_concise_dcf,
    read_concise_dcf,
)

# Number of entries; index, sub-index, size and data of each: little-endian (CiA 302-3).
BYTES = bytes.fromhex("02000000 1710 00 02000000 3200 0018 02 01000000 01")
ENTRIES = (ConciseEntry(0x1017, 0, b"\x32\0"), ConciseEntry(0x1800, 2, b"\1"))


@pytest.fixture
def make_dcf(tmp_path):
    """Returns the valve's EDS as a DCF with these values: make_dcf({"1017": 50})."""

    def make(values):
        text = VALVE_408.read_text(encoding="utf-8")
        for section, value in values.items():
            head = f"[{section}]\n"
            assert head in text
            text = text.replace(head, f"{head}ParameterValue={value}\n")
        path = tmp_path / "valve.dcf"
        path.write_text(text, encoding="utf-8")
        return path

    return make


def test_the_layout_is_that_of_the_standard():
    assert pack_concise_dcf(ENTRIES) == BYTES
    assert parse_concise_dcf(BYTES) == ENTRIES


@pytest.mark.parametrize(
    ("raw", "what"),
    [
        (b"\1\0", "2 bytes are no concise DCF"),
        (BYTES[:-1], "ends within entry 2, 0x1800.02: 0 of 1 bytes are there"),
        (BYTES[:-3], "ends after 1 of 2 entries"),
        (BYTES + b"\0", "1 bytes follow its 2 entries"),
        (struct.pack("<IHBI", 1, 0x1017, 0, 0xFFFF_FFFF), "0 of 4294967295 bytes are there"),
        (b"\xff\xff\xff\xff", "ends after 0 of 4294967295 entries"),
    ],
)
def test_what_is_none_is_refused(raw, what):
    with pytest.raises(ConciseDcfError, match=what):
        parse_concise_dcf(raw)


def test_a_file_is_named(tmp_path):
    path = tmp_path / "valve.cdcf"
    with pytest.raises(ConciseDcfError, match=r"valve.cdcf: cannot be read: No such file"):
        read_concise_dcf(path)
    path.write_bytes(BYTES[:6])
    with pytest.raises(ConciseDcfError, match=r"valve.cdcf: ends after 0 of 2 entries"):
        read_concise_dcf(path)
    path.write_bytes(BYTES)
    assert read_concise_dcf(path) == ENTRIES


def test_a_dcf_gives_the_bytes_of_dcfgen(tmp_path, make_dcf):
    """dcfgen of Lely CANopen makes concise DCFs from settings of its own; here the same ones."""
    made = run_dcfgen(
        tmp_path,
        """
master: {node_id: 127, heartbeat_consumer: false}
valve:
  dcf: valve.eds
  node_id: 1
  heartbeat_producer: 50
  tpdo:
    1:
      transmission: 1
      event_timer: 0
      mapping:
        - {index: 0x6301, sub_index: 1}
        - {index: 0x6041, sub_index: 0}
""",
        valve=VALVE_408,
    )
    dcf = make_dcf(
        {
            "1017": 50,
            "1800sub2": 1,
            "1800sub5": 0,
            "1A00sub0": 2,
            "1A00sub1": "0x63010110",
            "1A00sub2": "0x60410010",
        }
    )
    assert pack_concise_dcf(convert_dcf(dcf, 1)) == (made / "valve.bin").read_bytes()


def test_a_cob_id_follows_the_node_id(make_dcf):
    entries = convert_dcf(make_dcf({"1800sub1": "$NODEID+0x280"}), 5)
    assert entries == (
        ConciseEntry(0x1800, 1, bytes.fromhex("85020080")),
        ConciseEntry(0x1800, 1, bytes.fromhex("85020000")),
    )


COB_ID, TYPE, COUNT = (0x1800, 1), (0x1800, 2), (0x1A00, 0)
FIRST, SECOND = (0x1A00, 1), (0x1A00, 2)
DISABLED, ENABLED = (COB_ID, "81010080"), (COB_ID, "81010000")


@pytest.mark.parametrize(
    ("values", "defaults", "writes"),
    [
        ({TYPE: "01"}, {}, [(TYPE, "01")]),
        ({TYPE: "01"}, {COB_ID: 0x181}, [DISABLED, (TYPE, "01"), ENABLED]),
        ({TYPE: "01", COB_ID: "81010000"}, {}, [DISABLED, (TYPE, "01"), ENABLED]),
        ({COUNT: "00"}, {}, [(COUNT, "00")]),
        (
            {FIRST: "0a", SECOND: "0b", COUNT: "01"},
            {},
            [(COUNT, "00"), (FIRST, "0a"), (COUNT, "01")],
        ),
        ({FIRST: "0a"}, {COUNT: 1}, [(COUNT, "00"), (FIRST, "0a"), (COUNT, "01")]),
        (
            {FIRST: "0a", SECOND: "0b"},
            {},
            [(COUNT, "00"), (FIRST, "0a"), (SECOND, "0b"), (COUNT, "02")],
        ),
    ],
)
def test_a_pdo_is_disabled_emptied_and_mapped_in_the_order_of_cia_301(values, defaults, writes):
    raw = {key: bytes.fromhex(value) for key, value in values.items()}
    assert order_writes(raw, defaults) == tuple(
        ConciseEntry(*key, bytes.fromhex(value)) for key, value in writes
    )


def test_an_eds_configures_nothing():
    assert convert_dcf(VALVE_408, 1) == ()


def test_what_is_read_only_or_a_command_is_left_out(make_dcf):
    assert convert_dcf(make_dcf({"1000": 1, "1010sub1": "0x65766173"}), 1) == ()


@pytest.mark.parametrize("value", ["fifty", "70000", "1.5"])
def test_a_value_that_does_not_fit_is_named(make_dcf, value):
    with pytest.raises(ConciseDcfError, match=rf"\[1017\] ParameterValue '{value}' does not fit"):
        convert_dcf(make_dcf({"1017": value}), 1)


def test_a_real_number_may_be_given_by_its_bits(tmp_path):
    path = tmp_path / "sensor.dcf"
    # 1.5 is 0x3FC00000 in IEEE 754.
    for text in ("1.5", "0x3FC00000"):
        path.write_text(
            f"[6126]\nParameterName=Factor\nDataType=0x8\nAccessType=rw\nParameterValue={text}\n",
            encoding="utf-8",
        )
        assert convert_dcf(path, 1) == (ConciseEntry(0x6126, 0, bytes.fromhex("0000C03F")),)


def test_what_is_no_dcf_is_refused(make_file):
    path = make_file("none.dcf", bytes(range(256)))
    with pytest.raises(EdsError):
        convert_dcf(path, 1)
