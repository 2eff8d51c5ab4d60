from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.tables import from_text

import device_profiles
from hil_bench.canopen_device.eds import LARGEST_FILE, load_eds
from hil_bench.canopen_device.eds_checks import find_faults
from hil_bench.canopen_device.eds_document import Severity
from hil_bench.canopen_device.errors import EdsError
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import Access, Variable

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


@from_text("old", "new", "severity", "message")
def test_found_and_loaded_all_the_same(load_changed, old, new, severity, message):
    dictionary = load_changed((old, new))
    found = [f for f in dictionary.findings if f"[{f.section}] {f.text}".startswith(message)]
    assert [f.severity for f in found] == [severity], [str(f) for f in dictionary.findings]
    assert list(find_faults(dictionary)) == []
    Node(dictionary, 5).start(0)


def test_the_file_of_the_other_tests_has_no_findings(object_dictionary):
    assert object_dictionary.findings == ()


def test_mapping_of_more_than_64_bit(load_changed):
    dictionary = load_changed(
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
    (finding,) = [f for f in dictionary.findings if f.severity is Severity.ERROR]
    assert finding.text == "DefaultValue: maps 72 bit; a PDO carries at most 64; TPDO1 is off"
    assert dictionary.variable(0x1800, 1).default == 0xC0000185  # bit 31: it does not exist
    assert dictionary.variable(0x1A00, 0).default == 0


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


def test_two_devices_of_a_file_share_nothing_that_changes(eds_path, make_file):
    first = load_eds(eds_path, 5)
    size = len(list(first))
    entry = first.variable(0x1017)
    entry.default, entry.value, entry.is_carried = 77, 99, True
    first.add_hook(0x1017, 0, lambda _value: pytest.fail("the hook of another device"))
    first.add(Variable(0x5FFF, 0, "One more", entry.data_type))
    other = make_file("other.eds", eds_path.read_bytes())

    second = load_eds(other, 5)

    assert (first.source, second.source) == (str(eds_path), str(other))
    assert len(list(second)) == size
    twin = second.variable(0x1017)
    assert (twin.default, twin.value, twin.is_carried, twin.is_plain) == (0, 0, False, True)
    second.download(0x1017, 0, b"\x0a\x00")
    assert entry.value == 99


@pytest.mark.parametrize("node_id", [0, 128, -1])
def test_node_id_is_checked(eds_path, node_id):
    assert refusal(load_eds, eds_path, node_id).endswith(
        f"device.eds: node-ID {node_id} is not possible; write 1 to 127, or 255 for none"
    )


def test_missing_file(tmp_path):
    message = refusal(load_eds, tmp_path / "none.eds", 5)
    assert message.endswith("none.eds: No such file or directory; name an EDS file that exists")


@from_text("text", "wrong")
def test_text_that_is_no_eds(make_file, text, wrong):
    path = make_file("no.eds", text)
    assert refusal(load_eds, path, 5).startswith(f"{path}: {wrong}")


def test_a_file_that_is_too_long_is_not_read(make_file):
    path = make_file("long.eds", b"[FileInfo]\n[1000]\n" + b";" * LARGEST_FILE)
    assert "is longer than 8388608 bytes" in refusal(load_eds, path, 5)


def test_bytes_that_are_no_text(make_file):
    path = make_file("no.eds", bytes(range(256)))
    assert refusal(load_eds, path, 5).startswith(f"{path}: ")


@pytest.mark.parametrize("name", ["VALVE_408", "PRESSURE_404", "ENCODER_406"])
def test_own_profiles_load(name):
    assert 0x1018 in load_eds(getattr(device_profiles, name), 127)


@settings(max_examples=50, deadline=None)
@given(data=st.data())
def test_a_damaged_file_loads_all_the_same(tmp_path_factory, data):
    lines = EDS.read_text(encoding="utf-8").splitlines()
    place = data.draw(st.integers(0, len(lines) - 1))
    key = lines[place].partition("=")[0]
    value = data.draw(st.sampled_from(["", "0x", "-1", "x", "nan", "0", "0xFFFFFFFFFF", "$NODEID"]))
    damage = data.draw(st.sampled_from([[], [key], [f"{key}={value}"], [lines[place]] * 2]))
    lines[place : place + 1] = damage
    path = tmp_path_factory.mktemp("eds") / "damaged.eds"
    path.write_text("\n".join(lines), encoding="utf-8")
    Node(load_eds(path, 5), 5)
