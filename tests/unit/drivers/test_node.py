"""One device: SDO transfers and their errors, heartbeat and emergency messages, its EDS."""

import pytest

from device_profiles import PRESSURE_404
from hil_drivers import (
    DeviceMismatchError,
    DriverTimeoutError,
    EdsError,
    NmtState,
    RemoteProtocolError,
    SdoAbortError,
)
from hil_drivers.eds import load_eds
from hil_drivers.pdo import PdoKind, eds_mappings


@pytest.fixture
def node(network, encoder_eds):
    return network.add_node(4, encoder_eds)


def test_read_returns_the_value_by_its_type(node, expected_protocol):
    # 0x6004 is an INTEGER32: FF FF FF FE little endian is -2 + ... read as two's complement.
    with expected_protocol([("604#40.04.60.00.00.00.00.00", "584#43.04.60.00.FE.FF.FF.FF")]):
        assert node.read(0x6004) == -2


def test_write_packs_the_value_by_its_type(node, expected_protocol):
    # 0x1017 is an UNSIGNED16: two bytes, so command 2B (CiA 301, expedited, size 2).
    with expected_protocol([("604#2B.17.10.00.64.00.00.00", "584#60.17.10.00.00.00.00.00")]):
        node.write(0x1017, 0, 100)


def test_segmented_answers_are_put_together(node, expected_protocol):
    steps = [
        ("604#40.08.10.00.00.00.00.00", "584#41.08.10.00.09.00.00.00"),  # 9 bytes to come
        ("604#60.00.00.00.00.00.00.00", "584#00.50.6F.73.69.74.69.6F"),
        ("604#70.00.00.00.00.00.00.00", "584#1B.6E.21.00.00.00.00.00"),  # 2 bytes, the last
    ]
    with expected_protocol(steps):
        assert node.sdo.upload(0x1008, 0) == b"Position!"[:7] + b"n!"


def test_an_abort_names_object_code_and_text(node, expected_protocol):
    steps = [("604#2B.17.10.00.64.00.00.00", "584#80.17.10.00.22.00.00.08")]
    with expected_protocol(steps), pytest.raises(SdoAbortError) as caught:
        node.write(0x1017, 0, 100)
    assert caught.value.code == 0x08000022
    assert "node 4: cannot write 0x1017 (Producer heartbeat time): SDO abort 0x08000022" in str(
        caught.value
    )
    assert "present device state" in str(caught.value)


def test_silence_times_out_and_ends_the_transfer(node, expected_protocol, bus):
    steps = [
        ("604#40.04.60.00.00.00.00.00", None),
        ("604#80.04.60.00.00.00.04.05", None),  # abort 0504 0000, of the object asked for
    ]
    with (
        expected_protocol(steps),
        pytest.raises(DriverTimeoutError, match=r"0x6004 .*: no SDO answer within 0\.5 s"),
    ):
        node.read(0x6004)
    assert bus.now() == pytest.approx(100.5)


def test_an_answer_for_another_object_is_a_protocol_error(node, expected_protocol):
    with (
        expected_protocol([("604#40.04.60.00.00.00.00.00", "584#43.05.60.01.E8.03.00.00")]),
        pytest.raises(RemoteProtocolError, match="node 4: cannot read 0x6004"),
    ):
        node.read(0x6004)


def test_a_short_answer_is_counted_and_waited_over(node, expected_protocol, network):
    answers = ["584#43.04", "584#43.04.60.00.07.00.00.00"]
    with expected_protocol([("604#40.04.60.00.00.00.00.00", answers)]):
        assert node.read(0x6004) == 7
    assert network.counters.malformed == 1


def test_an_answer_of_another_size_is_a_mismatch(node, expected_protocol):
    # One byte where the EDS says INTEGER32.
    with (
        expected_protocol([("604#40.04.60.00.00.00.00.00", "584#4F.04.60.00.07.00.00.00")]),
        pytest.raises(DeviceMismatchError, match="came as 1 bytes; 4 are right"),
    ):
        node.read(0x6004)


def test_unasked_answers_do_not_pile_up(node, network, bus):
    bus.play(*["584#43.04.60.00.07.00.00.00"] * 256)
    network.pump()
    bus.play("584#43.04.60.00.07.00.00.00")
    network.pump()
    assert network.counters.malformed == 1
    assert node.sdo.responses.qsize() == 256


def test_an_unasked_answer_is_not_taken_for_the_next(node, network, bus, expected_protocol):
    bus.play("584#43.04.60.00.07.00.00.00")
    network.pump()
    with expected_protocol([("604#40.04.60.00.00.00.00.00", "584#43.04.60.00.08.00.00.00")]):
        assert node.read(0x6004) == 8


def test_a_booting_device_is_waited_for(node, expected_protocol):
    steps = [
        ("604#40.00.10.00.00.00.00.00", None),  # lost: the device was not up yet
        ("604#80.00.10.00.00.00.04.05", None),
        ("604#40.00.10.00.00.00.00.00", "584#43.00.10.00.96.01.00.00"),
    ]
    with expected_protocol(steps):
        assert node.read_device_type() == 406


def test_a_missing_device_is_given_up(node, bus):
    with pytest.raises(DriverTimeoutError, match="node 4: no answer within 2 s"):
        node.read_device_type()
    assert bus.now() == pytest.approx(102.0)


def test_an_object_that_the_eds_lacks_names_both(node, encoder_eds):
    with pytest.raises(DeviceMismatchError, match=rf"{encoder_eds.name} has no 0x6131\.01"):
        node.read(0x6131, 1)
    # 0x6004 has no sub-indices, though canopen would find it under any.
    with pytest.raises(DeviceMismatchError, match=r"0x6004\.01"):
        node.read(0x6004, 1)


def test_a_value_that_does_not_fit_is_refused_before_it_is_sent(node, bus):
    with pytest.raises(ValueError, match="70000 does not fit 0x1017"):
        node.write(0x1017, 0, 70000)
    assert bus.sent == []


@pytest.mark.parametrize(
    ("frame", "state"),
    [
        # States of the heartbeat message in CiA 301; boot-up (0) leads on to PRE-OPERATIONAL.
        ("704#00", NmtState.PRE_OPERATIONAL),
        ("704#04", NmtState.STOPPED),
        ("704#05", NmtState.OPERATIONAL),
        ("704#7F", NmtState.PRE_OPERATIONAL),
    ],
)
def test_heartbeats_tell_the_nmt_state(node, network, bus, frame, state):
    bus.play(frame)
    network.pump()
    assert (node.nmt_state, node.heard_at) == (state, 100.0)


@pytest.mark.parametrize("frame", ["704#", "704#05.00", "704#33", "084#00.10.01", "084#"])
def test_malformed_messages_change_nothing(node, network, bus, frame):
    bus.play(frame)
    network.pump()
    assert (node.nmt_state, list(node.emergencies)) == (None, [])
    assert network.counters.malformed == 1


def test_emergencies_are_kept_with_their_meaning(node, network, bus):
    bus.play("084#50.82.11.01.02.03.04.05", "084#00.10.01.00.00.00.00.00")
    network.pump()
    first, second = node.emergencies
    assert (first.code, first.register, first.manufacturer) == (0x8250, 0x11, b"\1\2\3\4\5")
    assert first.meaning == "RPDO time-out"
    assert second.meaning == "Generic Error"
    assert node.active_emergency == second
    bus.play("084#00.00.00.00.00.00.00.00")
    network.pump()
    assert node.active_emergency is None


def test_only_the_last_emergencies_are_kept(node, network, bus):
    bus.play(*[f"084#{code:02X}.10.01.00.00.00.00.00" for code in range(40)])
    network.pump()
    assert [emergency.code for emergency in node.emergencies] == [0x1000 + n for n in range(8, 40)]


def test_emergencies_come_under_the_cob_id_of_the_eds(network, bus, edit_eds, encoder_eds):
    node = network.add_node(4, edit_eds(encoder_eds, {"1014": "$NODEID+0xA0"}))
    bus.play("0A4#00.10.01.00.00.00.00.00")
    network.pump()
    assert len(node.emergencies) == 1


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("", "no object such as"),
        ("no section\n", "no object such as"),
        ("[DeviceInfo]\n[MandatoryObjects]\n1=0x1000\n", "no object such as"),
    ],
)
def test_an_eds_that_is_none_is_refused_in_one_line(network, make_file, content, reason):
    eds = make_file("broken.eds", content)
    with pytest.raises(EdsError, match=rf"^[^\n]*broken\.eds [^\n]*{reason}[^\n]*$"):
        network.add_node(4, eds)


def test_a_missing_eds_is_refused_with_its_path(network, tmp_path):
    with pytest.raises(EdsError, match=r"missing\.eds: No such file"):
        network.add_node(4, tmp_path / "missing.eds")


def test_a_pdo_without_a_mapping_is_left_out(network, edit_eds, encoder_eds, caplog):
    eds = edit_eds(encoder_eds, {}, removed=["1A00", *(f"1A00sub{sub}" for sub in range(9))])
    node = network.add_node(4, eds)
    assert [mapping.number for mapping in eds_mappings(node, PdoKind.TPDO)] == [2]
    assert "[1800] has no mapping [1A00]; the PDO is left out" in caplog.text


# What canopen's own reader fails at, and what the object is then: data type, access, default.
DEVIATIONS = {
    "no data type": ("[2000]\nParameterName=x\nAccessType=ro\n", (0x0F, "ro", None)),
    "no access type": ("[2000]\nParameterName=x\nDataType=5\nDefaultValue=3\n", (5, "rw", 3)),
    "no name": ("[2000]\nDataType=5\nAccessType=ro\n", (5, "ro", None)),
    "twice": ("[2000]\nDataType=5\nDefaultValue=3\n[2000]\nDefaultValue=4\n", (5, "rw", 3)),
    "a line of its own kind": ("[2000]\nDataType=5\nwhatever\n", (5, "rw", None)),
    "DummyUsage with gaps": ("[DummyUsage]\nDummy0001=1\n[2000]\nDataType=5\n", (5, "rw", None)),
    "comments announced": ("[Comments]\nLines=9\n[2000]\nDataType=5\n", (5, "rw", None)),
    "an empty number": ("[DeviceInfo]\nVendorNumber=\n[2000]\nDataType=5\n", (5, "rw", None)),
    "another code page": ("[2000]\nParameterName=D\xfcse \x85\nDataType=5\n", (5, "rw", None)),
}


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16"])
@pytest.mark.parametrize("name", DEVIATIONS)
def test_what_makers_write_is_read(network, make_file, name, encoding):
    text, expected = DEVIATIONS[name]
    eds = make_file("maker.eds", text.encode(encoding))
    variable = network.add_node(4, eds).variable(0x2000)
    assert (variable.data_type, variable.access_type, variable.default) == expected


def test_entries_written_compactly_and_without_their_object(network, make_file):
    eds = make_file(
        "maker.eds",
        "[1800]\nObjectType=9\n[1800sub1]\nDataType=7\nDefaultValue=$NODEID+0x180\n"
        "[1A00]\nObjectType=9\nDataType=7\nCompactSubObj=3\n[1A00Value]\n1=0x20010210\n2=0x20020008\n"
        "[2001sub2]\nDataType=6\n[2002]\nDataType=5\n",
    )
    node = network.add_node(4, eds)
    (mapping,) = eds_mappings(node, PdoKind.TPDO)
    assert (mapping.cob_id, [mapped.key for mapped in mapping.objects]) == (
        0x184,
        [(0x2001, 2), (0x2002, 0)],
    )
    assert node.variable(0x2001, 2).data_type == 6


def test_two_nodes_of_one_eds_share_nothing(encoder_eds):
    one, same, other = (load_eds(encoder_eds, number) for number in (4, 4, 5))
    one[0x1017].default = 77
    assert same[0x1017].default == other[0x1017].default == 0
    assert same[0x1017].parent is same
    assert [each[0x1800][1].default for each in (same, other)] == [0x40000184, 0x40000185]


def test_a_real_number_is_no_integer(network, expected_protocol):
    node = network.add_node(2, PRESSURE_404)
    with (
        expected_protocol([("602#40.30.61.01.00.00.00.00", "582#43.30.61.01.00.00.20.40")]),
        pytest.raises(DeviceMismatchError, match=r"0x6130\.01 is a real number"),
    ):
        node.read_integer(0x6130, 1)


def test_defaults_come_from_the_eds(node):
    assert node.default(0x1018, 2, otherwise=7) == 0x406
    assert node.default(0x2000, otherwise=7) == 7  # not in the EDS
