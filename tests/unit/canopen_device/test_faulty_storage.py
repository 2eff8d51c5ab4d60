"""Each I/O call that stores parameters fails in turn: the old ones or the new ones are there."""

import os

import pytest
from support.faulty_disk import Fault, FaultyDisk

from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.errors import StorageError
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.storage import FileStorage

pytestmark = pytest.mark.parametrize("fault", Fault)
OLD, NEW = b'{"old": 1}\n', b'{"new": 2, "longer": "than the old ones"}\n'


@pytest.fixture
def path(tmp_path):
    return tmp_path / "folder" / "valve.parameters"


@pytest.fixture
def disk(path, monkeypatch):
    path.parent.mkdir()
    return FaultyDisk(monkeypatch, path.parent)


def each_failure(disk, fault, prepare, act):
    """Act again and again, each time with the next call failing, until none is left to fail.

    Yields:
        What the act returned.
    """
    at = calls = 0
    while at <= calls:
        prepare()
        with disk.failing(fault, at):
            result = act()
        calls = len(disk.calls)
        assert not disk.descriptors
        yield result
        at += 1
    for name in ("mkdir", "mkstemp", "fdopen", "write", "fsync", "close", "replace", "open"):
        assert name in disk.calls


def test_the_file_holds_the_old_data_or_the_new_and_no_other_file_is_left(path, disk, fault):
    storage = FileStorage(path)

    def store():
        try:
            storage.write(NEW)
        except StorageError as error:
            return str(error)
        return None

    problems = set()
    for problem in each_failure(disk, fault, lambda: storage.write(OLD), store):
        problems.add(problem)
        assert list(path.parent.iterdir()) == [path]
        assert storage.read() in ({NEW} if problem is None else {OLD, NEW})
    if fault is Fault.SHORT:
        assert problems == {None}
    else:
        reason = os.strerror(fault.value)
        expected = f"{path}: cannot be written: {reason}; what was stored before stays"
        assert problems - {None} == {expected}


def test_the_master_gets_an_abort_and_the_device_starts_on_what_it_had(path, disk, fault, eds_path):
    def power_on():
        node = Node(load_eds(eds_path, 5), 5, FileStorage(path))
        node.start(0)
        request(node, "")
        return node

    def request(node, data):
        """Return the data of what the node sends to an SDO request."""
        sent = []
        node.receive(Frame(0x605, bytes.fromhex(data)), 0)
        node.serve(0, sent.append)
        return [frame.data.hex() for frame in sent]

    def set_and_store(node, heartbeat):
        request(node, f"2b171000{heartbeat}0000")
        return request(node, "2310100173617665")  # "save" to 0x1010.01

    def prepare():
        path.unlink(missing_ok=True)
        nodes[:] = [power_on()]
        assert set_and_store(nodes[0], "6400") == ["6010100100000000"]

    nodes = []
    for answer in each_failure(disk, fault, prepare, lambda: set_and_store(nodes[0], "c800")):
        restarted = power_on()
        assert restarted.storage_problem is None
        heartbeat = restarted.object_dictionary.variable(0x1017).value
        if answer == ["6010100100000000"]:
            assert (heartbeat, nodes[0].storage_problem) == (200, None)
        else:
            # CiA 301, table 22: 0606 0000h, access failed due to a hardware error.
            assert answer == ["8010100100000606"]
            assert heartbeat in {100, 200}
            assert nodes[0].storage_problem.endswith("; what was stored before stays")
