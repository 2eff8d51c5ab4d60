from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import device_profiles
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import Access
from hil_bench.errors import EdsError

EDS = Path(__file__).with_name("device.eds")


@pytest.fixture
def load_changed(eds_path, tmp_path):
    """Load the test device's EDS with texts (old, new) changed, each there once."""

    def load(*changes):
        text = eds_path.read_text(encoding="utf-8")
        for old, new in changes:
            assert text.count(old) == 1, f"{old!r} is there {text.count(old)} times"
            text = text.replace(old, new)
        changed = tmp_path / "changed.eds"
        changed.write_text(text, encoding="utf-8")
        return load_eds(changed, 5)

    return load


def refusal(call, *arguments):
    with pytest.raises(EdsError) as refused:
        call(*arguments)
    message = str(refused.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    ("index", "subindex", "value"),
    [
        (0x1800, 1, 0x40000185),  # $NODEID+0x40000180
        (0x1018, 4, 0x12345678),
        (0x1008, 0, "Test device"),
        (0x2024, 0, 1.5),  # REAL32 by its bit pattern 0x3FC00000
        (0x2025, 0, b"\x01\x02\x03"),
        (0x2027, 0, "é"),
        (0x2028, 0, -1),
        (0x2012, 0, 0.0),  # no default
        (0x2030, 0, 3),  # CompactSubObj
        (0x2030, 1, 7),
        (0x2030, 2, -7),  # [2030Value]
        (0x2030, 3, 7),
    ],
)
def test_defaults(object_dictionary, index, subindex, value):
    assert object_dictionary.variable(index, subindex).default == value
    assert object_dictionary.variable(index, subindex).value == value


def test_limits_access_and_mapping(object_dictionary):
    set_point = object_dictionary.variable(0x2001)
    assert (set_point.low, set_point.high) == (-1000, 1000)
    assert set_point.access is Access.RWW
    assert set_point.mappable
    gain = object_dictionary.variable(0x2024)
    assert (gain.low, gain.high) == (-2.0, 2.0)  # the library ignores limits of REAL32
    assert not gain.mappable


@pytest.mark.parametrize(
    ("default", "value"),
    [
        ("2", 2.0),
        ("-0.25", -0.25),
        ("0xBE800000", -0.25),
        ("1e-1", 0.10000000149011612),  # 0.1 as REAL32: 0x3DCCCCCD = 13421773 x 2^-27
    ],
)
def test_real_default(load_changed, default, value):
    dictionary = load_changed(("DefaultValue=0x3FC00000", f"DefaultValue={default}"))
    assert dictionary.variable(0x2024).value == value


def test_limit_equal_to_that_of_the_type_is_none(load_changed):
    dictionary = load_changed(
        ("LowLimit=-1000\nHighLimit=1000", "LowLimit=0x8000\nHighLimit=0x7FFF")
    )
    assert dictionary.variable(0x2001).is_plain


def test_absent_default_goes_to_the_nearest_limit(load_changed):
    dictionary = load_changed(("DefaultValue=1\nLowLimit=1\n", "LowLimit=1\n"))
    assert dictionary.variable(0x2026).value == 1


def test_parameter_value_of_a_dcf_wins(load_changed):
    dictionary = load_changed(("DefaultValue=abc", "DefaultValue=abc\nParameterValue=xyz"))
    assert dictionary.variable(0x2020).default == "xyz"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "DefaultValue=0x00000191",
            "DefaultValue=010",
            (
                "[1000] DefaultValue: '010' has a leading zero, which is octal in CiA 306 and "
                "decimal to most tools; write 10 or 0xA"
            ),
        ),
        (
            "DefaultValue=0x00000191",
            "DefaultValue=four",
            "[1000] DefaultValue: 'four' is no number; write 384, 0x180 or $NODEID+0x180",
        ),
        (
            "DefaultValue=0x12345678",
            "DefaultValue=0x112345678",
            "[1018sub4] DefaultValue: '0x112345678' is outside UNSIGNED32; write 0 to 4294967295",
        ),
        (
            "DefaultValue=0x3FC00000",
            "DefaultValue=3E800000",
            "[2024] DefaultValue: '3E800000' is no REAL32; write 1.5 or its bit pattern 0x3FC00000",
        ),
        (
            "DefaultValue=0x3FC00000",
            "DefaultValue=1e39",
            "[2024] DefaultValue: '1e39' is no REAL32",
        ),
        (
            "DefaultValue=0x3FC00000",
            "DefaultValue=3",
            "[2024] DefaultValue 3 is outside its limits; write -2.0 to 2.0",
        ),
        (
            "LowLimit=-1000",
            "LowLimit=1001",
            "[2001] LowLimit 1001 is above HighLimit 1000",
        ),
        ("LowLimit=-2.0", "LowLimit=nan", "[2024] LowLimit nan is no limit; write a number"),
        (
            "DefaultValue=01 02 03",
            "DefaultValue=1 2",
            "[2025] DefaultValue: '1 2' is no byte string",
        ),
        ("DefaultValue=abc", "DefaultValue=ä", "[2020] DefaultValue: 'ä' has characters outside"),
        ("2=-7", "2=x", "[2030Value] 2: 'x' is no number"),
        ("CompactSubObj=3", "CompactSubObj=300", "[2030] CompactSubObj 300 is not possible"),
        (
            "DataType=0x000F\nAccessType=rw",
            "DataType=0x00A0\nAccessType=rw",
            "[2021] DataType 0x00A0 is unknown; write one of 0x0001",
        ),
        (
            "AccessType=wo",
            "AccessType=write",
            "[2022] AccessType write is unknown; write one of ro",
        ),
        ("AccessType=wo\n", "", "[2022] AccessType is missing; write one of ro"),
        ("ParameterName=Key\n", "", "[2022] has no ParameterName"),
        ("ObjectType=0x2", "ObjectType=0x5", "[2021] ObjectType 0x5 is unknown; write 0x2"),
        ("[1018sub0]", "[1018sub9]", "[1018] has no sub-index 0; add [1018sub0]"),
        ("[1018sub1]", "[2918sub1]", "[2918sub1] has no object; add [2918]"),
        ("[DeviceInfo]", "[Device]", "[DeviceInfo] is missing"),
        ("[1001]", "[2099]", "[1001] is missing; CiA 301 makes it mandatory"),
        ("[1018sub1]", "[1018sub5]", "[1018sub1] is missing; CiA 301 makes it mandatory"),
        (
            "ParameterName=Producer heartbeat time\nObjectType=0x7\nDataType=0x0006",
            "ParameterName=Producer heartbeat time\nObjectType=0x7\nDataType=0x0007",
            "[1017] has DataType UNSIGNED32; CiA 301 says UNSIGNED16",
        ),
        (
            "DefaultValue=0x20010010",
            "DefaultValue=0x40000010",
            "[1600sub2] maps 0x4000.00 (16 bit), which does not exist",
        ),
        (
            "DefaultValue=0x20010010",
            "DefaultValue=0x20260008",
            "[1600sub2] maps 0x2026.00 (8 bit), which has PDOMapping=0",
        ),
        (
            "DefaultValue=0x20010010",
            "DefaultValue=0x20100010",
            "[1600sub2] maps 0x2010.00 (16 bit), which has AccessType=ro, which no RPDO may carry",
        ),
        (
            "DefaultValue=0x20110010",
            "DefaultValue=0x20010010",
            "[1A00sub2] maps 0x2001.00 (16 bit), which has AccessType=rww, which no TPDO may carry",
        ),
        (
            "DefaultValue=0x20010010",
            "DefaultValue=0x20010008",
            "[1600sub2] maps 0x2001.00 (8 bit), which is INTEGER16, which has 16 bit",
        ),
        ("[1801sub2]", "[1801sub9]", "[1801sub2] is missing; a PDO needs its transmission type"),
        ("[1A01sub1]", "[1A01sub2]", "[1A01sub1] is missing; 0x1A01.00 says 1 mapped objects"),
    ],
)
def test_refused(load_changed, old, new, message):
    assert f"changed.eds: {message}" in refusal(load_changed, (old, new))


def test_pdo_without_mapping(load_changed):
    gone = ((f"[{section}]", f"[no {section}]") for section in ("1A01", "1A01sub0", "1A01sub1"))
    message = refusal(load_changed, *gone)
    assert message.endswith("[1A01] is missing; 0x1801 needs its mapping there")


def test_mapping_of_more_than_64_bit(load_changed):
    message = refusal(
        load_changed,
        ("0x20100010", "0x20280020"),
        ("0x20110010", "0x20280020"),
        (
            (
                "[1A00sub3]\nParameterName=Mapped object 3\nObjectType=0x7\nDataType=0x0007\n"
                "AccessType=rw\nDefaultValue=0\n"
            ),
            (
                "[1A00sub3]\nParameterName=Mapped object 3\nObjectType=0x7\nDataType=0x0007\n"
                "AccessType=rw\nDefaultValue=0x10010008\n"
            ),
        ),
        (
            (
                "ParameterName=Number of mapped objects\nObjectType=0x7\nDataType=0x0005\n"
                "AccessType=rw\nDefaultValue=2\nPDOMapping=0\n\n[1A00sub1]"
            ),
            (
                "ParameterName=Number of mapped objects\nObjectType=0x7\nDataType=0x0005\n"
                "AccessType=rw\nDefaultValue=3\nPDOMapping=0\n\n[1A00sub1]"
            ),
        ),
    )
    assert message.endswith("[1A00] maps 72 bit; a PDO carries at most 64")


def test_a_device_without_node_id_has_the_defaults_of_the_last_one(eds_path):
    dictionary = load_eds(eds_path, 255)
    assert dictionary.variable(0x1014).default == 0x80 + 127


def test_defaults_follow_a_new_node_id(eds_path):
    dictionary = load_eds(eds_path, 5)
    dictionary.assign_node_id(9)
    dictionary.restore(range(0x1000, 0x10000))
    expected = load_eds(eds_path, 9)
    for variable in dictionary:
        assert variable.value == expected.variable(variable.index, variable.subindex).value
    assert dictionary.variable(0x1400, 1).value == 0x209


@pytest.mark.parametrize("node_id", [0, 128, -1])
def test_node_id_is_checked(eds_path, node_id):
    assert refusal(load_eds, eds_path, node_id).endswith(
        f"device.eds: node-ID {node_id} is not possible; write 1 to 127, or 255 for none"
    )


def test_missing_file(tmp_path):
    message = refusal(load_eds, tmp_path / "none.eds", 5)
    assert message.endswith("none.eds: No such file or directory; name an EDS file that exists")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "no section",
        "[DeviceInfo]\n[DeviceInfo]\n",
        "[DeviceInfo]\nNrOfRXPDO=x\n",
        "[DeviceInfo]\n[Comments]\nLines=x\n",
        "[DeviceInfo]\n[DummyUsage]\nDummy0001=0\n",
        "[DeviceInfo]\n[1000sub1]\nParameterName=x\nDataType=7\nAccessType=ro\n",
    ],
)
def test_text_that_is_no_eds(tmp_path, text):
    path = tmp_path / "no.eds"
    path.write_text(text, encoding="utf-8")
    assert refusal(load_eds, path, 5).startswith(f"{path}: ")


def test_bytes_that_are_no_text(tmp_path):
    path = tmp_path / "no.eds"
    path.write_bytes(bytes(range(256)))
    assert refusal(load_eds, path, 5).startswith(f"{path}: ")


@pytest.mark.parametrize("name", ["VALVE_408", "PRESSURE_404", "ENCODER_406"])
def test_own_profiles_load(name):
    assert 0x1018 in load_eds(getattr(device_profiles, name), 127)


@settings(max_examples=50, deadline=None)
@given(data=st.data())
def test_damaged_file_loads_or_is_refused_in_one_line(tmp_path_factory, data):
    lines = EDS.read_text(encoding="utf-8").splitlines()
    place = data.draw(st.integers(0, len(lines) - 1))
    key = lines[place].partition("=")[0]
    value = data.draw(st.sampled_from(["", "0x", "-1", "x", "nan", "0", "0xFFFFFFFFFF", "$NODEID"]))
    damage = data.draw(st.sampled_from([[], [key], [f"{key}={value}"], [lines[place]] * 2]))
    lines[place : place + 1] = damage
    path = tmp_path_factory.mktemp("eds") / "damaged.eds"
    path.write_text("\n".join(lines), encoding="utf-8")
    message = ""
    try:
        Node(load_eds(path, 5), 5)
    except EdsError as refused:
        message = str(refused)
    assert "\n" not in message
