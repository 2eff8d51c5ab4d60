"""The EDS files as CiA 306 and as two loaders want them."""

import re
import warnings
from configparser import ConfigParser
from pathlib import Path

import canopen
import pytest
from dcf.device import Device
from dcf.lint import lint
from dcf.parse import parse_file

from device_profiles import (
    DRIVE_402,
    ENCODER_406,
    ENCODER_REDUNDANT_406,
    IMITATIONS,
    PRESSURE_404,
    ROTARY_ENCODER_406,
    TRANSDUCER_404,
    VALVE_408,
)
from hil_bench.canopen_device.datatypes import DOMAIN, REAL32
from hil_bench.canopen_device.eds import load_eds

NODE_ID = 5
IMITATED = sorted(IMITATIONS.glob("*.eds"))
FILES = [
    VALVE_408,
    PRESSURE_404,
    TRANSDUCER_404,
    ENCODER_406,
    ENCODER_REDUNDANT_406,
    ROTARY_ENCODER_406,
    DRIVE_402,
    *IMITATED,
]
DOCUMENT = Path(__file__).parents[3] / "docs" / "devices.md"

OBJECT = re.compile(r"([0-9A-F]{4})")
ENTRY = re.compile(r"([0-9A-F]{4})sub([0-9A-F]+)")
BITS = {0x2: 8, 0x3: 16, 0x4: 32, 0x5: 8, 0x6: 16, 0x7: 32, 0x8: 32, 0x10: 24}


@pytest.fixture(params=FILES, ids=lambda path: path.stem)
def path(request):
    return request.param


@pytest.fixture
def text(path):
    return path.read_text(encoding="ascii")


@pytest.fixture
def sections(text):
    parser = ConfigParser(interpolation=None)
    parser.optionxform = str
    parser.read_string(text)
    return parser


def listed(sections, name):
    indices = [value for key, value in sections[name].items() if key != "SupportedObjects"]
    assert int(sections[name]["SupportedObjects"]) == len(indices)
    return [int(value, 16) for value in indices]


def objects(sections):
    return [int(name, 16) for name in sections.sections() if OBJECT.fullmatch(name)]


def test_file_info_is_that_of_cia_306(path, sections):
    info = sections["FileInfo"]
    assert info["FileName"] == path.name
    assert info["EDSVersion"] == "4.0"
    assert 0 <= int(info["FileVersion"]) <= 255
    assert 0 <= int(info["FileRevision"]) <= 255
    for what in ("Creation", "Modification"):
        assert re.fullmatch(r"(0[1-9]|1[0-2])-[0-3]\d-\d{4}", info[f"{what}Date"])
        assert re.fullmatch(r"(0[1-9]|1[0-2]):[0-5]\d(AM|PM)", info[f"{what}Time"])


def test_the_object_lists_name_each_object_once(sections):
    mandatory = listed(sections, "MandatoryObjects")
    named = (
        mandatory + listed(sections, "OptionalObjects") + listed(sections, "ManufacturerObjects")
    )
    assert mandatory == [0x1000, 0x1001, 0x1018]
    assert sorted(named) == sorted(objects(sections))


def test_device_info_agrees_with_the_objects(sections):
    info = sections["DeviceInfo"]
    assert int(info["NrOfRXPDO"]) == sum(0x1400 <= index < 0x1600 for index in objects(sections))
    assert int(info["NrOfTXPDO"]) == sum(0x1800 <= index < 0x1A00 for index in objects(sections))
    for option, entry in (
        *(("VendorNumber", "1018sub1"), ("ProductNumber", "1018sub2")),
        *(("RevisionNumber", "1018sub3"),),
    ):
        assert int(info[option], 16) == int(sections[entry]["DefaultValue"], 16)


def test_sub_number_counts_the_entries(sections):
    for index in objects(sections):
        name = f"{index:04X}"
        subs = [s for s in sections.sections() if (m := ENTRY.fullmatch(s)) and m[1] == name]
        assert int(sections[name].get("SubNumber", "0")) == len(subs)
        assert (int(sections[name]["ObjectType"], 16) == 0x7) == (not subs)


def test_numbers_are_in_the_common_subset_of_the_loaders(sections):
    for name in sections.sections():
        section = sections[name]
        for option in ("LowLimit", "HighLimit"):
            assert re.fullmatch(r"0|-?[1-9]\d*", section.get(option, "0"))
        if section.get("DataType") == "0x0008":
            assert "DefaultValue" not in section
        elif section.get("DataType") not in {None, "0x0009", "0x000F"}:
            assert re.fullmatch(
                r"0x[0-9A-F]+|0|-?[1-9]\d*|\$NODEID\+0x[0-9A-F]+", section["DefaultValue"]
            )


def test_each_default_mapping_is_to_a_mappable_object_of_that_length(sections):
    for index in objects(sections):
        if not (0x1600 <= index < 0x1800 or 0x1A00 <= index < 0x1C00):
            continue
        count = int(sections[f"{index:04X}sub0"]["DefaultValue"])
        bits = 0
        for sub in range(1, count + 1):
            entry = int(sections[f"{index:04X}sub{sub:X}"]["DefaultValue"], 16)
            name = f"{entry >> 16:04X}"
            mapped = sections[f"{name}sub{entry >> 8 & 0xFF:X}" if entry >> 8 & 0xFF else name]
            assert mapped["PDOMapping"] == "1"
            assert entry & 0xFF == BITS[int(mapped["DataType"], 16)]
            allowed = {"rww", "rw", "wo"} if index < 0x1800 else {"ro", "rwr", "rw"}
            assert mapped["AccessType"] in allowed
            bits += entry & 0xFF
        assert 0 < bits <= 64


def test_both_loaders_read_the_same(path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        theirs = canopen.import_od(str(path), node_id=NODE_ID)
    for variable in load_eds(path, NODE_ID):
        other = theirs.get_variable(variable.index, variable.subindex)
        assert other.data_type == variable.data_type.code
        assert other.access_type == variable.access.value
        assert other.pdo_mappable == variable.mappable
        if variable.data_type not in {REAL32, DOMAIN}:
            assert other.default == variable.default


@pytest.mark.parametrize("node_id", [1, 127])
def test_identifiers_follow_the_node_id(path, node_id):
    dictionary = load_eds(path, node_id)
    # Pre-defined connection set of CiA 301: EMCY 0x80, TPDOn 0x80 + 0x100 n, SDO 0x600 and 0x580.
    assert dictionary.variable(0x1014).default == 0x80 + node_id
    first = dictionary.indices(range(0x1800, 0x1A00))[0]
    cob_id = 0x180 + (first - 0x1800) * 0x100 + node_id
    assert dictionary.variable(first, 1).default & 0x7FF == cob_id
    assert dictionary.variable(0x1200, 1).default == 0x600 + node_id
    assert dictionary.variable(0x1200, 2).default == 0x580 + node_id


@pytest.mark.parametrize(
    ("path", "device_type", "product_code"),
    # Low word: the profile's number. High word: decision 0003.
    [
        (VALVE_408, 0x00000198, 0x408),
        (PRESSURE_404, 0x00020194, 0x404),
        (TRANSDUCER_404, 0x00020194, 0x414),
        (ENCODER_406, 0x00080196, 0x406),
        (ROTARY_ENCODER_406, 0x00020196, 0x407),
        (DRIVE_402, 0x00020192, 0x402),
        (ENCODER_REDUNDANT_406, 0x000A0196, 0x416),
    ],
)
def test_identity(path, device_type, product_code):
    dictionary = load_eds(path, NODE_ID)
    assert dictionary.variable(0x1000).default == device_type
    assert dictionary.variable(0x1018, 1).default == 0
    assert dictionary.variable(0x1018, 2).default == product_code


def test_imitations_say_that_they_are_none_of_a_maker():
    product_codes = [load_eds(path, NODE_ID).number(0x1018, 2) for path in FILES]
    assert len(set(product_codes)) == len(FILES)
    for path in IMITATED:
        assert load_eds(path, NODE_ID).number(0x1018, 1) == 0
        assert "Not the file of any maker" in path.read_text(encoding="ascii")
    assert len(IMITATED) == 6


def pdo(dictionary, communication):
    """COB-ID, transmission type, event timer and mapping of one PDO."""
    mapping = communication + 0x200
    count = dictionary.variable(mapping).default
    return (
        *(dictionary.variable(communication, sub).default for sub in (1, 2, 5)),
        [dictionary.variable(mapping, sub).default for sub in range(1, count + 1)],
    )


@pytest.mark.parametrize(
    ("path", "communication", "expected"),
    # docs/devices.md, "Default PDOs": bit 30 no remote request, bit 31 off; 0xIIIISSLL.
    [
        (VALVE_408, 0x1400, (0x205, 255, 0, [0x60400010, 0x63000110])),
        (VALVE_408, 0x1800, (0x40000185, 255, 10, [0x60410010, 0x63010110])),
        (PRESSURE_404, 0x1800, (0x40000185, 254, 10, [0x61300120, 0x61500108])),
        (TRANSDUCER_404, 0x1801, (0x40000285, 254, 10, [0x61300220, 0x61500208])),
        (TRANSDUCER_404, 0x1802, (0x40000385, 254, 100, [0x61300320, 0x61500308])),
        (ENCODER_406, 0x1800, (0x40000185, 254, 10, [0x60040020, 0x60300110])),
        (ENCODER_406, 0x1801, (0xC0000285, 1, 0, [0x60040020, 0x60300110])),
        (ENCODER_REDUNDANT_406, 0x1800, (0x40000185, 254, 10, [0x60200120, 0x60300110])),
        (ENCODER_REDUNDANT_406, 0x1801, (0x40000285, 254, 10, [0x60200220, 0x60300210])),
        (DRIVE_402, 0x1400, (0x205, 255, 0, [0x60400010, 0x60600008])),
        (DRIVE_402, 0x1401, (0x305, 255, 0, [0x607A0020, 0x60FF0020])),
        (DRIVE_402, 0x1800, (0x40000185, 255, 10, [0x60410010, 0x60610008])),
        (DRIVE_402, 0x1801, (0x40000285, 255, 10, [0x60640020, 0x606C0020])),
        # "Imitated devices" there.
        (
            IMITATIONS / "encoder_multi_sensor.eds",
            *(0x1800, (0x40000185, 254, 1, [0x60200120, 0x60300110, 0x64000108])),
        ),
        (IMITATIONS / "pressure_int32.eds", 0x1800, (0x40000185, 254, 10, [0x91300120])),
        (
            IMITATIONS / "pressure_int16_status.eds",
            *(0x1800, (0x40000185, 254, 10, [0x71300110, 0x61500108])),
        ),
        (IMITATIONS / "analogue_io_401.eds", *(0x1401, (0x305, 255, 0, [0x64110110, 0x64110210]))),
        (
            IMITATIONS / "analogue_io_401.eds",
            *(0x1801, (0x40000285, 255, 10, [0x64010110, 0x64010210, 0x64010310, 0x64010410])),
        ),
        (IMITATIONS / "valve_pdo4.eds", 0x1400, (0x205, 255, 0, [0x60400010])),
        (IMITATIONS / "valve_pdo4.eds", 0x1403, (0x505, 255, 0, [0x60400010, 0x63000110])),
        (IMITATIONS / "valve_pdo4.eds", 0x1800, (0x40000185, 255, 10, [0x60410010])),
        (IMITATIONS / "valve_pdo4.eds", 0x1803, (0x40000485, 255, 10, [0x60410010, 0x63010110])),
    ],
)
def test_default_pdos(path, communication, expected):
    assert pdo(load_eds(path, NODE_ID), communication) == expected


def test_tools_that_label_by_name_can_tell_the_objects_of_pdos_apart(path):
    names = [v.name.casefold() for v in load_eds(path, NODE_ID) if v.mappable]
    assert len(set(names)) == len(names) > 0


def test_every_object_is_told_in_the_documentation(path):
    document = DOCUMENT.read_text(encoding="utf-8")
    missing = {
        f"0x{variable.index:04X}"
        for variable in load_eds(path, NODE_ID)
        if f"0x{variable.index:04X}" not in document
    }
    assert missing == set()


def test_lely_accepts_it(path):
    # What its program dcfchk does. Its findings are warnings, which are errors here.
    file = parse_file(str(path))
    assert lint(file)
    assert Device(file, {"NODEID": NODE_ID})


def test_lely_would_find_a_mistake(path, text, make_file):
    broken = make_file(path.name, re.sub(r"(\[1018\][^\[]*SubNumber=)5", r"\g<1>6", text))
    with pytest.warns(UserWarning, match="1018"):
        assert not lint(parse_file(str(broken)))
