"""The node against another implementation: the master side of the `canopen` library.

The bus is synchronous: what the library sends reaches the node at once, and the node's answers are
back before `send_message` returns. No thread, no wait.
"""

import canopen
import pytest


class SynchronousNetwork(canopen.Network):
    def __init__(self, rig):
        super().__init__()
        self._rig = rig

    def send_message(self, can_id, data, remote=False):
        self._rig.receive(can_id, bytes(data), is_remote=remote)
        self.run()

    def run(self, milliseconds=1):
        for frame in self._rig.run(milliseconds):
            self.notify(frame.can_id, bytearray(frame.data), self._rig.now / 1e9)


@pytest.fixture
def network(rig):
    return SynchronousNetwork(rig)


@pytest.fixture
def remote(network, eds_path):
    return network.add_node(5, str(eds_path))


def test_sdo_reads_and_writes(remote):
    assert remote.sdo[0x1018][4].raw == 0x12345678
    assert remote.sdo["Manufacturer device name"].raw == "Test device"
    remote.sdo["Text"].raw = "a text of more than one segment"
    assert remote.sdo["Text"].raw == "a text of more than one segment"
    remote.sdo["Gain"].raw = -0.5
    assert remote.sdo["Gain"].raw == -0.5
    remote.sdo["Text"].raw = "x"
    assert remote.sdo["Text"].raw == "x"


@pytest.mark.parametrize("size", [0, 1, 4, 5, 7, 8, 14, 1000])
def test_sdo_domain_of_any_length(remote, rig, size):
    data = bytes(number % 251 for number in range(size))
    rig.node.object_dictionary.variable(0x2021).value = data
    assert remote.sdo.upload(0x2021, 0) == data
    remote.sdo.download(0x2021, 0, data[::-1], force_segment=True)
    assert rig.node.object_dictionary.variable(0x2021).value == data[::-1]


@pytest.mark.parametrize(
    ("index", "subindex", "data", "code"),
    [
        (0x4000, 0, b"\x01", 0x06020000),
        (0x1018, 1, bytes(4), 0x06010002),
        (0x2026, 0, b"\x0b", 0x06090031),
    ],
)
def test_sdo_abort(remote, index, subindex, data, code):
    with pytest.raises(canopen.SdoAbortedError) as aborted:
        remote.sdo.download(index, subindex, data)
    assert aborted.value.code == code


def test_nmt_and_heartbeat(remote, network):
    remote.sdo["Producer heartbeat time"].raw = 100
    network.run(100)
    assert remote.nmt.state == "PRE-OPERATIONAL"
    remote.nmt.state = "OPERATIONAL"
    network.run(100)
    assert remote.nmt.state == "OPERATIONAL"


def test_pdos_as_the_library_reads_them_from_the_device(remote, network, rig):
    remote.tpdo.read()
    remote.rpdo.read()
    received = []
    remote.tpdo[1].add_callback(lambda pdo: received.append([v.raw for v in pdo]))
    remote.nmt.state = "OPERATIONAL"

    remote.rpdo[1]["Command"].raw = 7
    remote.rpdo[1]["Set-point"].raw = -500
    remote.rpdo[1].transmit()
    assert rig.node.object_dictionary.variable(0x2000).value == 7
    assert rig.node.object_dictionary.variable(0x2001).value == -500

    rig.node.object_dictionary.variable(0x2010).value = 0x0203
    rig.node.object_dictionary.variable(0x2011).value = -3
    rig.node.trigger_tpdo(1)
    network.run()
    assert received == [[0, 0], [0x0203, -3]]


def test_mapping_by_the_library_and_sync(remote, network, rig):
    remote.tpdo.read()
    tpdo = remote.tpdo[4]
    tpdo.clear()
    tpdo.add_variable("Status")
    tpdo.add_variable("Measured value")
    tpdo.trans_type = 1
    tpdo.enabled = True
    tpdo.save()
    received = []
    tpdo.add_callback(lambda pdo: received.append([v.raw for v in pdo]))
    rig.node.object_dictionary.variable(0x2010).value = 9
    rig.node.object_dictionary.variable(0x2012).value = 2.5
    remote.nmt.state = "OPERATIONAL"

    network.sync.transmit()

    assert received == [[9, 2.5]]


def test_emcy(remote, network, rig):
    rig.node.emcy.raise_error(0x3100, 0x04, b"\x01\x02")
    network.run()
    (error,) = remote.emcy.active
    assert (error.code, error.register, error.data) == (0x3100, 0x05, b"\x01\x02\x00\x00\x00")
    rig.node.emcy.clear_error(0x3100)
    network.run()
    assert remote.emcy.active == []
