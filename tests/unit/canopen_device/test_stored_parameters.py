"""What is stored, and which stored parameters a device refuses."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.errors import ConfigError, StorageError
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.storage import MemoryStorage, StoredParameters

IDENTITY = (0, 1, 0x10000)  # vendor-ID, product code and revision of device.eds

PARAMETERS = st.builds(
    StoredParameters,
    identity=st.tuples(*[st.integers(0, 0xFFFFFFFF)] * 3),
    node_id=st.none() | st.integers(1, 127) | st.just(255),
    bit_timing=st.none() | st.integers(0, 8),
    values=st.dictionaries(
        st.tuples(st.integers(0x1000, 0xFFFF), st.integers(0, 255)), st.binary(max_size=20)
    ),
)


@given(parameters=PARAMETERS)
def test_the_text_holds_everything(parameters):
    assert StoredParameters.decode(parameters.encode()) == parameters


@pytest.mark.parametrize(
    "text",
    [
        *(b"", b"{", b"[]", b"null", b"5", b"\xff", b"[" * 100_000),
        *(b'{"identity": [1, 2]}', b'{"identity": [1, 2, 3]}'),
        b'{"identity": [1, 2, 3], "node_id": "5", "bit_timing": null, "objects": {}}',
        b'{"identity": [1, 2, true], "node_id": null, "bit_timing": null, "objects": {}}',
        b'{"identity": [1, 2, 3], "node_id": null, "bit_timing": null, "objects": []}',
        b'{"identity": [1, 2, 3], "node_id": null, "bit_timing": null, "objects": {"1017": ""}}',
        b'{"identity": [1, 2, 3], "node_id": null, "bit_timing": null, "objects": {"1.0": "x"}}',
        b'{"identity": [1, 2, 3], "node_id": null, "bit_timing": null, "objects": {"1.0": 5}}',
    ],
)
def test_another_text_is_refused(text):
    with pytest.raises(StorageError, match="malformed"):
        StoredParameters.decode(text)


def store(**changes):
    storage = MemoryStorage()
    values = {name: bytes.fromhex(raw) for name, raw in changes.pop("values", {}).items()}
    storage.write(StoredParameters(**{"identity": IDENTITY, "values": values} | changes).encode())
    return storage


def power_on(eds_path, storage, node_id=5):
    return Node(load_eds(eds_path, node_id), node_id, storage)


def test_stored_values_are_in_force_at_once(eds_path):
    node = power_on(eds_path, store(values={(0x1017, 0): "6400"}))
    assert node.storage_problem is None
    assert node.object_dictionary.variable(0x1017).value == 100


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"identity": (0, 1, 0x20000)}, r"of device \(0, 1, 131072\), this one is \(0, 1, 65536\)"),
        ({"node_id": 128}, "node-ID 128 is not possible"),
        ({"node_id": 0}, "node-ID 0 is not possible"),
        ({"bit_timing": 256}, "bit timing 256 is not possible"),
        ({"bit_timing": -1}, "bit timing -1 is not possible"),
        ({"values": {(0x4000, 0): "00"}}, "0x4000.00 is no object that can be stored"),
        ({"values": {(0x1000, 0): "00000000"}}, "0x1000.00 is no object that can be stored"),
        ({"values": {(0x1010, 1): "00000000"}}, "0x1010.01 is no object that can be stored"),
        ({"values": {(0x2000, 0): "0700"}}, "0x2000.00 is no object that can be stored"),
        ({"values": {(0x1017, 0): "64"}}, "0x1017.00: .*length of service parameter too low"),
        ({"values": {(0x2026, 0): "0b"}}, "0x2026.00: value of parameter written too high"),
        ({"values": {(0x1600, 1): "10003020"}}, "0x1600 maps 0x2030"),
        ({"values": {(0x1600, 0): "09"}}, "0x1600 maps 0x0000"),
    ],
)
def test_parameters_that_make_no_sense_are_not_used(eds_path, changes, problem):
    good = {(0x1017, 0): "6400"}
    changes["values"] = good | changes.get("values", {})
    node = power_on(eds_path, store(**changes))

    assert node.storage_problem is not None
    with pytest.raises(StorageError, match=problem):
        raise StorageError(node.storage_problem)
    assert node.node_id == 5
    assert 0x5530 in node.emcy.present
    defaults = load_eds(eds_path, 5)
    for variable in node.object_dictionary:
        if variable.index not in {0x1001, 0x1003}:
            assert variable.value == defaults.variable(variable.index, variable.subindex).value


@given(data=st.binary(max_size=60) | PARAMETERS.map(StoredParameters.encode))
def test_no_stored_data_harm_a_device(make_rig, data):
    rig = make_rig()
    storage = MemoryStorage()
    storage.write(data)
    node = Node(rig.node.object_dictionary, 5, storage)
    sent = []
    node.start(0)
    node.serve(0, sent.append)
    assert sent or node.node_id == 255


def test_only_differences_are_stored(eds_path):
    storage = MemoryStorage()
    node = power_on(eds_path, storage)
    node.object_dictionary.download(0x1017, 0, b"\x64\x00")
    node.object_dictionary.download(0x1010, 1, b"save")
    assert json.loads(storage.read()) == {
        "identity": list(IDENTITY),
        "node_id": None,
        "bit_timing": None,
        "objects": {"1017.00": "6400"},
    }


def test_what_an_rpdo_carries_is_no_parameter(eds_path):
    storage = MemoryStorage()
    node = power_on(eds_path, storage)
    dictionary = node.object_dictionary
    dictionary.variable(0x2028).value = 7  # rw: a parameter, unless an RPDO carries it
    dictionary.download(0x1010, 1, b"save")
    assert "2028.00" in json.loads(storage.read())["objects"]
    for raw in ((0x1400, 1, "05020080"), (0x1600, 0, "00"), (0x1600, 1, "20002820")):
        dictionary.download(raw[0], raw[1], bytes.fromhex(raw[2]))
    dictionary.download(0x1600, 0, b"\x01")
    dictionary.download(0x1010, 1, b"save")
    assert "2028.00" not in json.loads(storage.read())["objects"]


def test_a_node_without_node_id_needs_an_identity(object_dictionary):
    variables = [v for v in object_dictionary if (v.index, v.subindex) != (0x1018, 4)]
    dictionary = type(object_dictionary)(variables, "x.eds")
    with pytest.raises(ConfigError, match=r"x\.eds: a node without node-ID needs .* 0x1018\.01"):
        Node(dictionary, 255)
