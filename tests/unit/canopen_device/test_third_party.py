"""The node against another implementation: the master side of the `canopen` library.

The bus is synchronous: what the library sends reaches the node at once, and the node's answers are
back before `send_message` returns. No thread, no wait.
"""

from types import SimpleNamespace

import canopen
import canopen.lss
import pytest

from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.storage import MemoryStorage


class SynchronousNetwork(canopen.Network):
    def __init__(self, rig):
        super().__init__()
        self._rig = rig
        self.sent = 0
        self.lost = set()  # which of the messages sent are lost, by number

    def send_message(self, can_id, data, remote=False):
        self.sent += 1
        if self.sent not in self.lost:
            self._rig.receive(can_id, bytes(data), is_remote=remote)
        while self.run():
            pass

    def run(self, milliseconds=1):
        """Advance and pass on what the node sends; return whether it sent anything."""
        frames = self._rig.run(milliseconds)
        for frame in frames:
            self.notify(frame.can_id, bytearray(frame.data), self._rig.now / 1e9)
        return bool(frames)


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


@pytest.mark.parametrize("size", [1, 5, 7, 8, 14, 889, 890, 5000])
def test_sdo_block_transfer_both_ways(remote, rig, size):
    data = bytes(number % 251 for number in range(size))
    with remote.sdo.open(0x2021, 0, "wb", size=size, block_transfer=True) as file:
        file.write(data)
    assert rig.node.object_dictionary.variable(0x2021).value == data
    with remote.sdo.open(0x2021, 0, "rb", block_transfer=True) as file:
        assert file.read() == data
    assert rig.node.counters.sdo_aborts == 0


def test_sdo_block_download_with_a_lost_segment(remote, network, rig):
    data = bytes(number % 251 for number in range(2000))
    network.lost = {network.sent + 50}  # a segment in the midst of the first sub-block
    with remote.sdo.open(0x2021, 0, "wb", size=len(data), block_transfer=True) as file:
        file.write(data)
    assert rig.node.object_dictionary.variable(0x2021).value == data


def test_sdo_block_abort(remote):
    with pytest.raises(canopen.SdoAbortedError) as aborted:
        remote.sdo.open(0x1018, 1, "wb", size=4, block_transfer=True)
    assert aborted.value.code == 0x06010002


def test_second_sdo_channel(remote, network, rig):
    remote.sdo[0x1201][1].raw = 0x681
    remote.sdo[0x1201][2].raw = 0x682
    channel = remote.add_sdo(0x681, 0x682)
    channel.network = network  # which the library forgets
    assert channel[0x1018][4].raw == 0x12345678
    assert rig.node.counters.sdo_aborts == 0


def test_store_and_restore(remote):
    remote.sdo["Producer heartbeat time"].raw = 100
    remote.store()
    remote.nmt.state = "RESET"
    assert remote.sdo["Producer heartbeat time"].raw == 100
    remote.restore()
    assert remote.sdo["Producer heartbeat time"].raw == 100
    remote.nmt.state = "RESET"
    assert remote.sdo["Producer heartbeat time"].raw == 0


def test_node_guarding(remote, network):
    network.send_message(0x705, b"", remote=True)
    assert remote.nmt.state == "PRE-OPERATIONAL"
    remote.nmt.state = "OPERATIONAL"
    network.send_message(0x705, b"", remote=True)
    assert remote.nmt.state == "OPERATIONAL"


def test_time(remote, network, rig):
    remote.sdo["COB-ID time stamp"].raw = 0x80000100
    # 1 January 2000, noon: 946728000 s after 1970; day 0 is 1 January 1984, 16 years before.
    network.time.transmit(946728000)
    assert rig.node.time_of_day(rig.now) == (5844, 12 * 3600 * 1000 + 1)  # 1 ms later


def test_sync_with_counter(remote, network, rig):
    remote.sdo["Synchronous counter overflow value"].raw = 10
    remote.nmt.state = "OPERATIONAL"
    received = []
    remote.tpdo.read()
    remote.tpdo[2].add_callback(lambda pdo: received.append(pdo.timestamp))
    for count in (1, 2, 3, 4):
        network.sync.transmit(count)
    assert len(received) == 2  # TPDO2 is of type 2
    assert rig.node.counters.unexpected_sync_length == 0


def test_sync_producer(remote, network):
    received = []
    network.subscribe(0x080, lambda _id, data, timestamp: received.append((bytes(data), timestamp)))
    remote.sdo["Communication cycle period"].raw = 10_000
    remote.sdo["COB-ID SYNC message"].raw = 0x40000080
    received.clear()  # the first came at once
    for _ in range(30):
        network.run()
    assert len(received) == 3
    assert [data for data, _ in received] == [b""] * 3
    times = [timestamp for _, timestamp in received]
    assert times[2] - times[0] == pytest.approx(0.020)


def test_remote_request_for_a_pdo(remote, rig):
    remote.tpdo.read()
    remote.tpdo[2].enabled = False
    remote.tpdo[2].save()
    remote.tpdo[2].trans_type = 253
    remote.tpdo[2].rtr_allowed = True
    remote.tpdo[2].enabled = True
    remote.tpdo[2].save()
    remote.nmt.state = "OPERATIONAL"
    rig.node.object_dictionary.variable(0x2012).value = 2.5
    received = []
    remote.tpdo[2].add_callback(lambda pdo: received.append(pdo[0].raw))
    remote.tpdo[2].remote_request()
    assert received == [2.5]


@pytest.fixture
def lss(network, monkeypatch):
    """The library's LSS master, without its pauses: the answers are there at once."""
    monkeypatch.setattr(canopen.lss, "time", SimpleNamespace(sleep=lambda _seconds: None))
    network.lss.RESPONSE_TIMEOUT = 0.0
    return network.lss


ADDRESS = [0x0, 0x1, 0x10000, 0x12345678]  # 0x1018.01 to .04 of device.eds


def test_lss_selective_inquire_and_configure(lss, network, rig):
    assert lss.send_switch_state_selective(*ADDRESS)
    assert lss.inquire_node_id() == 5
    assert [lss.inquire_lss_address(specifier) for specifier in range(0x5A, 0x5E)] == ADDRESS
    lss.configure_bit_timing(2)
    with pytest.raises(canopen.lss.LssError):
        lss.configure_bit_timing(5)
    lss.configure_node_id(77)
    lss.store_configuration()
    lss.send_switch_state_global(lss.WAITING_STATE)
    assert rig.node.node_id == 5
    network.nmt.state = "RESET COMMUNICATION"
    assert rig.node.node_id == 77


def test_lss_identify(lss):
    lss.send_identify_remote_slave(0, 1, 0, 0x20000, 0x12345678, 0xFFFFFFFF)
    assert lss.responses.get_nowait() == b"\x4f" + bytes(7)
    lss.send_identify_remote_slave(0, 1, 0, 0x20000, 0x12345679, 0xFFFFFFFF)
    assert lss.responses.empty()


def test_lss_fastscan_finds_and_configures_a_device_without_node_id(lss, network, rig, eds_path):
    storage = MemoryStorage()
    rig.node = Node(load_eds(eds_path, 255), 255, storage)
    rig.node.start(rig.now)
    boot_ups = []
    network.subscribe(0x72A, lambda _id, data, _time: boot_ups.append(bytes(data)))

    assert lss.fast_scan() == (True, ADDRESS)
    lss.configure_node_id(42)
    lss.store_configuration()
    lss.send_switch_state_global(lss.WAITING_STATE)
    assert boot_ups == [b"\x00"]
    assert lss.fast_scan() == (False, None)

    remote = network.add_node(42, str(eds_path))
    assert remote.sdo["COB-ID emergency message"].raw == 0x80 + 42
    assert Node(load_eds(eds_path, 255), 255, storage).node_id == 42
