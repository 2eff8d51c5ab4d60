"""Each rule, tried on our own valve's EDS with one thing broken."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from device_profiles import ENCODER_406, PRESSURE_404, VALVE_408
from hil_bench.abilities.conformance.eds_check import check_eds
from hil_bench.canopen_device.eds_document import parse_document
from hil_bench.errors import ConfigError

VALVE = VALVE_408.read_text()


def section_line(text, name):
    return text[: text.index(f"[{name}]")].count("\n") + 1


def key_line(text, section, key):
    start = text.index(f"[{section}]")
    return text[: text.index(f"\n{key}=", start) + 1].count("\n") + 1


def set_key(text, section, key, value):
    head, rest = text[: text.index(f"[{section}]")], text[text.index(f"[{section}]") :]
    changed, count = re.subn(rf"\n{key}=[^\n]*", f"\n{key}={value}", rest, count=1)
    assert count == 1
    return head + changed


def drop_section(text, name):
    return re.sub(rf"\[{name}\]\n(?:[^\[\n][^\n]*\n|\n)*", "", text, count=1)


@pytest.fixture
def findings(tmp_path):
    def check(text):
        path = tmp_path / "device.eds"
        path.write_text(text)
        return check_eds(path)

    return check


@pytest.mark.parametrize("path", [VALVE_408, PRESSURE_404, ENCODER_406], ids=lambda p: p.stem)
def test_our_own_files_are_clean(path):
    assert check_eds(path) == []


@pytest.mark.parametrize(
    ("section", "key", "value", "text"),
    [
        ("FileInfo", "FileVersion", "256", "is 256; 0 to 255 is right"),
        ("FileInfo", "EDSVersion", "5.0", "is 5.0; 4.0 is right"),
        ("FileInfo", "CreationTime", "21:00", "is 21:00; hh:mmAM or hh:mmPM is right"),
        ("FileInfo", "CreationDate", "21-11-2026", "is 21-11-2026; mm-dd-yyyy is right"),
        ("DeviceInfo", "BaudRate_125", "2", "is 2; 0 to 1 is right"),
        ("DeviceInfo", "Granularity", "65", "is 65; 0 to 64 is right"),
        ("DeviceInfo", "NrOfRXPDO", "2", "is 2; 1 is right by the objects from 0x1400 on"),
        ("DummyUsage", "Dummy0003", "x", "is x; 0 to 1 is right"),
        ("MandatoryObjects", "SupportedObjects", "4", "is 4; 3 is right by what follows"),
        ("6040", "ObjectType", "0x6", "is 0x6; 0x2, 0x7, 0x8 or 0x9 is right"),
        ("6040", "DataType", "0x99", "'0x99' is no data type of CiA 301; the entry takes any"),
        ("6040", "PDOMapping", "2", "is '2'; 1 is right, and is taken"),
        ("6040", "AccessType", "rx", "is 'rx'; one of ro, wo, rw, rwr, rww, const is right, rw is"),
        ("6300", "SubNumber", "9", "is 9; 4 is right by the sections [6300sub...]"),
        ("1400sub1", "DefaultValue", "0x200+$NODEID", "is 0x200+$NODEID; $NODEID as the first"),
        ("1400sub1", "DefaultValue", "0x601", "is 0x601, which no PDO may have; RPDO1 is off"),
        ("1600sub1", "DefaultValue", "0x60F00010", "maps 0x60F0.00 (16 bit), which does not exist"),
        ("1600sub1", "DefaultValue", "0x60410010", "which has AccessType=ro, which no RPDO may"),
        ("1600sub1", "DefaultValue", "0x60400008", "is UNSIGNED16, which has 16 bit; RPDO1 is off"),
        ("1600sub1", "DefaultValue", "0x63000208", "which has PDOMapping=0; RPDO1 carries it all"),
        ("1600sub0", "DefaultValue", "254", "says that it is a multiplexed PDO; 0 to 64 mapped"),
        ("1600sub0", "DefaultValue", "65", "is 65; 0 to 64 mapped objects are supported"),
    ],
)
def test_a_broken_key_is_found_at_its_line(findings, section, key, value, text):
    broken = set_key(VALVE, section, key, value)
    found = [f for f in findings(broken) if text in f.text]
    assert found, [str(f) for f in findings(broken)]
    assert found[0].line == key_line(broken, section, key)
    assert found[0].section == section
    assert found[0].text.startswith(f"{key}: ")


def test_as_many_objects_may_be_mapped_as_a_pdo_has_bits(findings):
    texts = [found.text for found in findings(set_key(VALVE, "1600sub0", "DefaultValue", "64"))]
    assert any("says 64 mapped objects" in text for text in texts)
    assert not any("are supported" in text for text in texts)


@pytest.mark.parametrize(
    ("bits", "objects"),
    [
        (8, "1001 100D 1019 1029sub1"),
        (16, "100C 1015 1017"),
        (32, "1000 1003sub1 1005 1006 1007 1010sub1 1011sub1 1012 1014 1016sub1 1018sub1"),
    ],
)
def test_an_object_of_the_standard_has_its_data_type(findings, bits, objects):
    """CiA 301, 7.5.2."""
    for section in objects.split():
        broken = set_key(VALVE, section, "DataType", "0x0003")  # INTEGER16
        texts = [found.text for found in findings(broken) if found.section == section]
        right = f"CiA 301 says UNSIGNED{bits}, which it is here"
        assert f"DataType: is INTEGER16; {right}" in texts, section


def test_limits_and_default_must_be_in_order(findings):
    broken = set_key(VALVE, "6320sub1", "DefaultValue", "-20000")
    broken = broken.replace("[6320sub1]\n", "[6320sub1]\nLowLimit=-16384\n")
    texts = [f.text for f in findings(broken) if f.section == "6320sub1"]
    follows = "it is the value at power-on all the same"
    assert texts == [
        f"DefaultValue: '-20000' is outside its limits, -16384 to 32767; {follows}",
    ]


def test_a_default_outside_its_type_is_found(findings):
    broken = set_key(VALVE, "6314sub1", "DefaultValue", "40000")
    (finding,) = [f for f in findings(broken) if f.section == "6314sub1"][:1]
    assert "'40000' is outside INTEGER16; write -32768 to 32767" in finding.text


def test_an_object_without_a_place_in_a_list_is_found(findings):
    broken = VALVE.replace("3=0x1018", "3=0x2018").replace("[6040]", "[6049]")
    texts = {f"{f.section} {f.text}" for f in findings(broken)}
    assert "MandatoryObjects 3: 0x2018 has no section [2018]; the device does not have it" in texts
    assert "MandatoryObjects 3: 0x2018 belongs to ManufacturerObjects" in texts
    assert "MandatoryObjects 0x1018 is not listed; CiA 301 has it in every device" in texts
    assert "6049 is in no list of objects; one is right" in texts
    assert any("0x6040 has no section [6040]; the device does not" in text for text in texts)


def test_missing_sections_are_found(findings):
    for name in ("FileInfo", "DeviceInfo", "DummyUsage", "ManufacturerObjects"):
        texts = [f"{f.section}: {f.text}" for f in findings(drop_section(VALVE, name))]
        assert f"{name}: the section is missing; CiA 306 asks for it" in texts
    broken = VALVE
    for name in ("1600", *(f"1600sub{subindex}" for subindex in range(9))):
        broken = drop_section(broken, name)
    texts = [f.text for f in findings(broken)]
    assert "0x1600 with its mapping is missing; RPDO1 is off" in texts


def test_a_missing_count_of_sub_indices_is_found(findings):
    head, _, rest = VALVE.partition("[6300]")
    broken = f"{head}[6300]{re.sub('SubNumber=.*', '', rest, count=1)}"
    text = "SubNumber: is missing; 4 is right by the sections [6300sub...]"
    assert text in [found.text for found in findings(broken)]


def test_what_stands_twice_is_found_with_both_lines(findings):
    broken = VALVE + "\n[6040]\nParameterName=again\n\n[DeviceComissioning]\nNodeID=1\nNODEID=2\n"
    last = broken.count("\n")
    found = {finding.line: finding.text for finding in findings(broken)}
    first = section_line(VALVE, "6040")
    assert found[last - 5] == f"stands at line {first} already; what stands there counts"
    assert found[last] == f"NODEID: stands at line {last - 1} already; what stands there counts"


def test_the_standards_own_spelling_is_asked_for(findings):
    texts = [f.text for f in findings(VALVE + "\n[DeviceCommissioning]\nNodeID=1\n")]
    assert texts == ["DeviceComissioning, with one m, is CiA 306's spelling"]


def test_a_pdo_of_more_than_64_bit_is_found(findings):
    broken = VALVE
    for subindex in range(1, 6):
        broken = set_key(broken, f"1600sub{subindex}", "DefaultValue", "0x63000110")
    broken = set_key(broken, "1600sub0", "DefaultValue", "5")
    texts = " ".join(f.text for f in findings(broken))
    assert "maps 80 bit; a PDO carries at most 64; RPDO1 is off" in texts


def test_a_file_that_is_none_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"No such file or directory; name an EDS file that"):
        check_eds(tmp_path / "none.eds")


@given(st.text())
def test_any_text_is_parsed_without_an_exception(text):
    parse_document(text)


@pytest.mark.long
@given(st.data())
def test_a_damaged_file_never_breaks_the_checker(tmp_path_factory, data):
    lines = VALVE.splitlines()
    for _ in range(data.draw(st.integers(1, 6))):
        position = data.draw(st.integers(0, len(lines) - 1))
        lines[position] = data.draw(st.text(max_size=20) | st.sampled_from(lines))
    path = tmp_path_factory.mktemp("eds") / "damaged.eds"
    path.write_text("\n".join(lines), encoding="utf-8")
    for finding in check_eds(path):
        assert finding.line >= 1
