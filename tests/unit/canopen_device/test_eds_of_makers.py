"""EDS files as makers write them: each deviation from CiA 306 costs what it concerns, and no more.

Each file is made here, as small as the deviation allows, and put on a bus: what a controller that
is written for the real device sends and reads must work.
"""

import codecs
import random

import pytest

from device_profiles import VALVE_408
from hil_bench.canopen_device.errors import EdsError

HEAD = {
    "FileInfo": {"FileName": "maker.eds"},
    "DeviceInfo": {"VendorName": "Maker", "VendorNumber": "0x2A"},
    "1000": {"ParameterName": "Device type", "DataType": "7", "AccessType": "ro"},
    "1001": {"ParameterName": "Error register", "DataType": "5", "AccessType": "ro"},
    "1018": {"ParameterName": "Identity", "ObjectType": "9", "SubNumber": "2"},
    "1018sub0": {"ParameterName": "Count", "DataType": "5", "AccessType": "ro"},
    "1018sub1": {"ParameterName": "Vendor-ID", "DataType": "7", "AccessType": "ro"},
}
ENTRY = {"ParameterName": "Entry", "AccessType": "rw"}
U8, U32 = ENTRY | {"DataType": "5"}, ENTRY | {"DataType": "7"}
STRUCTURE = {"ParameterName": "Structure", "ObjectType": "9"}

READ_ONLY = b"\x80\x00\x20\x00\x02\x00\x01\x06"  # 0601 0002 for 0x2000.00


def pdo(communication, cob_id, *mapped):
    """The sections of a PDO of type 255, from the index of its communication parameters."""
    first, second = f"{communication:04X}", f"{communication + 0x200:04X}"
    entries = {
        f"{second}sub{number}": U32 | {"DefaultValue": f"0x{entry:08X}"}
        for number, entry in enumerate(mapped, start=1)
    }
    return {
        first: STRUCTURE,
        f"{first}sub0": U8 | {"DefaultValue": "2"},
        f"{first}sub1": U32 | {"DefaultValue": cob_id},
        f"{first}sub2": U8 | {"DefaultValue": "255"},
        second: STRUCTURE,
        f"{second}sub0": U8 | {"DefaultValue": str(len(mapped))},
        **entries,
    }


def without(sections, *names):
    return {name: keys for name, keys in sections.items() if name not in names}


def text_of(sections):
    return "\n".join(
        line
        for name, keys in (HEAD | sections).items()
        for line in (f"[{name}]", *(f"{key}={value}" for key, value in keys.items()))
    )


@pytest.fixture
def maker(tmp_path, rig_of):
    """Put a device of a maker's EDS on a bus: its head and more sections, or its bytes."""

    def build(sections):
        path = tmp_path / "maker.eds"
        if isinstance(sections, bytes):
            path.write_bytes(sections)
        else:
            path.write_text(text_of(sections), encoding="utf-8")
        return rig_of(path)

    return build


def findings(rig):
    """What is wrong in the file: severity, section and text of each finding."""
    found = rig.node.object_dictionary.findings
    return [(str(finding.severity), finding.section, finding.text) for finding in found]


def upload(rig, index, subindex=0):
    """The four bytes of an expedited upload."""
    (answer,) = rig.request(bytes([0x40, index & 0xFF, index >> 8, subindex, 0, 0, 0, 0]))
    assert answer[0] & 0xE3 == 0x43
    return answer[4 : 8 - (answer[0] >> 2 & 3)]


def start(rig):
    rig.receive(0x000, b"\x01\x05")
    return rig.run()


def text_upload(rig, index):
    """The bytes of a segmented upload."""
    (answer,) = rig.request(bytes([0x40, index & 0xFF, index >> 8, 0, 0, 0, 0, 0]))
    size, data, toggle = int.from_bytes(answer[4:], "little"), b"", 0
    while len(data) < size:
        (answer,) = rig.request(bytes([0x60 | toggle, *bytes(7)]))
        data += answer[1 : 8 - (answer[0] >> 1 & 7)]
        toggle ^= 0x10
    return data


def test_the_head_alone_is_a_device_without_findings(maker):
    rig = maker({})
    assert findings(rig) == []
    assert upload(rig, 0x1018) == b"\x01"  # no DefaultValue: the highest sub-index there is


@pytest.mark.parametrize(
    ("access", "finding"),
    [
        ("ro", ("warning", "2000", "LowLimit: 0 is above HighLimit -1; neither counts")),
        ("rw", ("error", "2000", "LowLimit: 0 is above HighLimit -1; the bus may write any value")),
    ],
)
def test_limits_that_turn_round_as_signed_numbers(maker, access, finding):
    # 0x00 to 0xFF of an INTEGER8 are 0 to -1: the maker thought of a byte.
    limits = {"LowLimit": "0x00", "HighLimit": "0xFF", "DefaultValue": "3"}
    keys = {"ParameterName": "Mode", "DataType": "2", "AccessType": access}
    rig = maker({"2000": keys | limits})
    assert findings(rig) == [finding]
    assert upload(rig, 0x2000) == b"\x03"
    (answer,) = rig.request(b"\x2f\x00\x20\x00\xfe\0\0\0")
    assert answer == (READ_ONLY if access == "ro" else b"\x60\x00\x20\x00\0\0\0\0")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1", "cp1252", "utf-16"])
def test_text_that_is_not_ascii(maker, encoding):
    keys = {"ParameterName": "Name", "DataType": "9", "AccessType": "const"}
    rig = maker(text_of({"1008": keys | {"DefaultValue": "Drücker °C"}}).encode(encoding))
    (finding,) = findings(rig)
    assert finding == (
        "warning",
        "1008",
        "DefaultValue: 'Drücker °C' has characters outside VISIBLE_STRING; each is replaced by '?'",
    )
    assert text_upload(rig, 0x1008) == b"Dr?cker ?C"


def test_bytes_of_windows_end_no_line(maker):
    # 0x85 is an ellipsis in cp1252 and a line end in Unicode; line numbers would be off by one.
    comment = b"[Comments]\nLine1=and so on \x85\n"
    rig = maker(comment + text_of({"2000": U8 | {"DefaultValue": "256"}}).encode("ascii"))
    (finding,) = rig.node.object_dictionary.findings
    lines = (comment + text_of({"2000": U8}).encode("ascii")).count(b"\n") + 1
    assert finding.line == lines + 1


def test_a_boolean_that_takes_a_byte(maker):
    keys = {"ParameterName": "Switch", "DataType": "1", "AccessType": "rw", "PDOMapping": "1"}
    rpdo, tpdo = pdo(0x1400, "$NODEID+0x200", 0x20000008), pdo(0x1800, "$NODEID+0x180", 0x20000008)
    rig = maker({"2000": keys, **rpdo, **tpdo})
    text = "DefaultValue: maps 0x2000.00 (8 bit), a BOOLEAN, with 8 bit; it takes a byte, 0 or 1"
    assert findings(rig) == [("warning", "1600sub1", text), ("warning", "1A00sub1", text)]
    assert [frame.data for frame in start(rig)] == [b"\x00"]
    rig.receive(0x205, b"\xff")
    rig.node.trigger_tpdo(1)
    assert [(frame.can_id, frame.data) for frame in rig.run()] == [(0x185, b"\x01")]


def test_a_read_only_object_in_an_rpdo(maker):
    keys = {"ParameterName": "Command", "DataType": "5", "AccessType": "ro", "PDOMapping": "1"}
    other = U8 | {"PDOMapping": "1"}
    rpdo = pdo(0x1400, "$NODEID+0x200", 0x20000008, 0x20010008)
    rig = maker({"2000": keys, "2001": other, **rpdo})
    ((severity, section, text),) = findings(rig)
    assert (severity, section) == ("warning", "1600sub1")
    assert text == (
        "DefaultValue: maps 0x2000.00 (8 bit), which has AccessType=ro, which no RPDO may carry; "
        "RPDO1 carries it all the same"
    )
    start(rig)
    rig.receive(0x205, b"\x07\x09")
    assert (upload(rig, 0x2000), upload(rig, 0x2001)) == (b"\x07", b"\x09")
    assert rig.request(b"\x2f\x00\x20\x00\x01\0\0\0") == [READ_ONLY]


@pytest.mark.parametrize("mapped", [0x20000010, 0x30000008, 0x20010008])
def test_a_mapping_that_makes_no_sense_costs_its_own_pdo(maker, mapped):
    """16 bit of an UNSIGNED8, an object that is not there, a text."""
    sections = {
        "2000": U8 | {"PDOMapping": "1"},
        "2001": {"ParameterName": "T", "DataType": "9", "AccessType": "rw", "PDOMapping": "1"},
        **pdo(0x1800, "$NODEID+0x180", mapped),
        **pdo(0x1801, "$NODEID+0x280", 0x20000008),
    }
    rig = maker(sections)
    ((severity, section, text),) = findings(rig)
    assert (severity, section) == ("error", "1A00sub1")
    assert text.endswith("; TPDO1 is off")
    assert [(frame.can_id, frame.data) for frame in start(rig)] == [(0x285, b"\x00")]
    assert upload(rig, 0x1800, 1) == b"\x85\x01\0\x80"  # bit 31: it does not exist
    # A master maps it anew, in the order of CiA 301.
    entry, count = b"\x23\x00\x1a\x01\x08\x00\x00\x20", b"\x2f\x00\x1a\x00\x01\0\0\0"
    for request in (entry, count, b"\x23\x00\x18\x01\x85\x01\0\0"):
        assert [answer[0] for answer in rig.request(request)] == [0x60]
    assert (0x185, b"\x00") in [(frame.can_id, frame.data) for frame in rig.run()]


def test_communication_parameters_without_a_mapping(maker):
    sections = without(pdo(0x1400, "$NODEID+0x200"), "1600", "1600sub0")
    rig = maker({"2000": U8 | {"PDOMapping": "1"}, **sections})
    text = "0x1600 with its mapping is missing; RPDO1 is off"
    assert findings(rig) == [("error", "1400", text)]
    start(rig)
    rig.receive(0x205, b"\x01")
    assert upload(rig, 0x1400, 1) == b"\x05\x02\0\x80"


def test_a_mapping_without_communication_parameters(maker):
    sections = without(pdo(0x1800, "0", 0x20000008), *(f"1800{sub}" for sub in ("", "sub0")))
    sections = without(sections, "1800sub1", "1800sub2")
    rig = maker({"2000": U8 | {"PDOMapping": "1"}, **sections})
    assert findings(rig) == [
        ("error", "1A00sub0", "0x1800 with its COB-ID is missing; there is no TPDO1")
    ]
    assert start(rig) == []


def test_a_pdo_without_a_transmission_type_goes_on_events(maker):
    sections = without(pdo(0x1800, "$NODEID+0x180", 0x20000008), "1800sub2")
    rig = maker({"2000": U8 | {"PDOMapping": "1"}, **sections})
    text = "[1800sub2] is missing; the transmission type is 255"
    assert findings(rig) == [("warning", "1800", text)]
    start(rig)
    rig.node.trigger_tpdo(1)
    assert [frame.can_id for frame in rig.run()] == [0x185]


def test_a_number_of_mapped_objects_that_follows_the_node_id(maker):
    sections = pdo(0x1800, "$NODEID+0x180", 0x20000008)
    sections["1A00sub0"] = U8 | {"DefaultValue": "$NODEID"}  # 5, and there is one entry
    rig = maker({"2000": U8 | {"PDOMapping": "1"}, **sections})
    assert [finding[0] for finding in findings(rig)] == ["error"]
    assert start(rig) == []
    assert upload(rig, 0x1A00) == b"\x00"


def test_a_missing_sub_index_0(maker):
    rig = maker({"2000": STRUCTURE, "2000sub1": U8, "2000sub3": U8})
    assert findings(rig) == [("warning", "2000", "[2000sub0] is missing; sub-index 0 is 3")]
    assert upload(rig, 0x2000) == b"\x03"


@pytest.mark.parametrize(
    ("cob_id", "found"),
    [
        (None, 0x185),  # CiA 301's own
        ("0x0", None),  # NMT's
        ("0x180", None),  # the maker forgot $NODEID, and CiA 301 restricts it
        ("0x6E0", None),
        ("$NODEID+0x20000180", None),  # 29 bit
    ],
)
def test_no_pdo_takes_an_identifier_of_another_service(maker, cob_id, found):
    sections = pdo(0x1800, cob_id or "", 0x20000008)
    rig = maker({"2000": U8 | {"PDOMapping": "1"}, **sections})
    assert [frame.can_id for frame in start(rig)] == ([found] if found else [])
    is_error = any("which no PDO may have; TPDO1 is off" in text for *_, text in findings(rig))
    assert is_error == (found is None)


@pytest.mark.parametrize("index", [0x1005, 0x1012, 0x1014])
def test_no_service_takes_the_identifier_of_nmt(maker, index):
    rig = maker({f"{index:04X}": U32 | {"DefaultValue": "0x40000000"}})
    own = {0x1005: "0x80", 0x1012: "0x100", 0x1014: "0x85"}[index]
    text = f"DefaultValue: '0x40000000' is of another service; {own} is taken"
    assert findings(rig) == [("error", f"{index:04X}", text)]
    rig.receive(0x000, b"\x01\x05")
    rig.node.emcy.raise_error(0x1000, 0)
    assert all(frame.can_id != 0 for frame in rig.run())
    assert rig.node.counters.unexpected_sync_length == 0


def test_services_without_a_default_have_that_of_cia_301(maker):
    rig = maker({"1014": U32, "1005": U32})
    rig.node.emcy.raise_error(0x1000, 0)
    assert 0x085 in [frame.can_id for frame in rig.run()]
    assert upload(rig, 0x1005) == b"\x80\0\0\0"
    dictionary = rig.node.object_dictionary
    dictionary.assign_node_id(9)  # EMCY's has the node-ID in it, SYNC's has not
    assert (dictionary.variable(0x1014).default, dictionary.variable(0x1005).default) == (137, 128)


def test_a_synchronous_pdo_without_the_object_of_sync(maker):
    sections = pdo(0x1800, "$NODEID+0x180", 0x20000008)
    sections["1800sub2"] = U8 | {"DefaultValue": "1"}
    rig = maker({"2000": U8 | {"PDOMapping": "1"}, **sections})
    text = "DefaultValue: is synchronous, and 0x1005 is missing; SYNC is 0x080 here"
    assert findings(rig) == [("warning", "1800sub2", text)]
    start(rig)
    rig.receive(0x080, b"")
    assert [frame.can_id for frame in rig.run()] == [0x185]


def test_a_record_written_compactly(maker):
    sections = without(pdo(0x1800, "$NODEID+0x180"), "1A00", "1A00sub0") | {
        "2000": U8 | {"PDOMapping": "1", "DefaultValue": "6"},
        "1A00": STRUCTURE | {"CompactSubObj": "2", "DataType": "7", "AccessType": "rw"},
        "1A00Value": {"NrOfEntries": "1", "1": "0x20000008"},
    }
    rig = maker(sections)
    assert findings(rig) == []
    assert [frame.data for frame in start(rig)] == [b"\x06"]


def test_a_data_type_of_canfestival(maker):
    # Its editor gives an object with limits a type of its own, whose sub-index 1 is the data type.
    alias = {"A0": STRUCTURE, "A0sub1": U8 | {"DefaultValue": "0x0006"}}
    rig = maker({**alias, "2000": ENTRY | {"DataType": "0x00A0", "DefaultValue": "258"}})
    assert findings(rig) == []
    assert upload(rig, 0x2000) == b"\x02\x01"


def test_an_unknown_data_type_takes_any_bytes(maker):
    rig = maker({"2000": ENTRY | {"DataType": "0x40", "DefaultValue": "0"}})
    ((severity, section, text),) = findings(rig)
    assert (severity, section) == ("error", "2000")
    assert text == (
        "DataType: '0x40' is no data type of CiA 301; the entry takes any bytes as a DOMAIN does, "
        "and cannot be mapped"
    )
    assert [answer[0] for answer in rig.request(b"\x23\x00\x20\x00\x01\x02\x03\x04")] == [0x60]
    assert upload(rig, 0x2000) == b"\x01\x02\x03\x04"


@pytest.mark.parametrize(
    ("vendor", "identity"), [("VendorNumber=0x2A\n", b"\x2a\0\0\0"), ("", bytes(4))]
)
def test_a_device_without_its_mandatory_objects(maker, vendor, identity):
    information = f"[FileInfo]\n[DeviceInfo]\n{vendor}"
    rig = maker(f"{information}[2000]\nParameterName=x\nDataType=5\nAccessType=rw".encode())
    assert [finding[:2] for finding in findings(rig)] == [
        *(("warning", "1000"), ("warning", "1001"), ("warning", "1018"), ("warning", "1018"))
    ]
    assert upload(rig, 0x1018, 1) == identity
    assert upload(rig, 0x1000) == bytes(4)


def test_what_stands_twice_counts_once(maker):
    text = text_of({"2000": U8 | {"DefaultValue": "1"}}) + "\n[2000]\nDefaultValue=2\n"
    rig = maker(text.encode())
    assert [finding[0] for finding in findings(rig)] == ["warning"]
    assert upload(rig, 0x2000) == b"\x01"


def test_keys_in_another_case_and_indented(maker):
    text = (
        text_of({}) + "\n[2000]\n  PARAMETERNAME=x\n\tdatatype=5\n  accesstype=RW ; read, write\n"
    )
    rig = maker(codecs.BOM_UTF8 + text.encode())
    assert findings(rig) == []
    assert upload(rig, 0x2000) == b"\x00"


def deleted(lines, rng):
    """A hundred lines are gone, here and there."""
    gone = set(rng.sample(range(len(lines)), 100))
    return [line for number, line in enumerate(lines) if number not in gone]


def truncated(lines, rng):
    """The file ends in the midst of a line."""
    end = rng.randrange(len(lines))
    return [*lines[:end], lines[end][: rng.randrange(1 + len(lines[end]))]]


def shuffled(lines, rng):
    """Lines stand in other sections than their own."""
    lines = list(lines)
    for _ in range(100):
        one, other = rng.randrange(len(lines)), rng.randrange(len(lines))
        lines[one], lines[other] = lines[other], lines[one]
    return lines


@pytest.mark.parametrize("damage", [deleted, truncated, shuffled])
def test_a_damaged_file_is_a_device_or_is_refused_in_a_line(maker, damage):
    lines = VALVE_408.read_text(encoding="ascii").splitlines()
    refused, devices = [], 0
    for seed in range(20):
        text = "\n".join(damage(lines, random.Random(seed)))  # noqa: S311 - damage, no secret
        try:
            rig = maker(text.encode())
        except EdsError as error:
            refused.append(str(error))
            continue
        devices += 1
        start(rig)
        rig.receive(0x201, bytes(8))
        rig.receive(0x080, b"")
        rig.run(100)
        for variable in rig.node.object_dictionary:
            at = variable.index.to_bytes(2, "little") + bytes([variable.subindex])
            (answer,) = rig.request(b"\x40" + at + bytes(4))
            assert answer[0] in {0x41, 0x42, 0x43, 0x47, 0x4B, 0x4F, 0x80}
    assert devices > 10
    assert not [message for message in refused if "\n" in message]


def test_an_sdo_server_without_cob_ids_has_those_of_cia_301(maker):
    # CiA 301, 7.2.3.1: request 0x600 + node-ID, answer 0x580 + node-ID; further servers are off.
    server = {"sub0": U8 | {"DefaultValue": "2"}, "sub1": U32, "sub2": U32}
    rig = maker(
        {f"{index}{sub}": keys for index in ("1200", "1201") for sub, keys in server.items()}
        | {"1200": STRUCTURE, "1201": STRUCTURE}
    )
    assert upload(rig, 0x1200, 1) == b"\x05\x06\0\0"
    assert upload(rig, 0x1200, 2) == b"\x85\x05\0\0"
    assert upload(rig, 0x1201, 1)[3] & 0x80
    assert upload(rig, 0x1201, 2)[3] & 0x80
