"""The file of stored parameters: whole or not at all, and damage is seen."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.canopen_device.errors import StorageError
from hil_bench.canopen_device.storage import FileStorage

DATA = b'{"identity": [0, 1, 65536]}\n'


@pytest.fixture
def path(tmp_path):
    return tmp_path / "folder" / "valve.parameters"


def test_nothing_stored_is_no_problem(path):
    assert FileStorage(path).read() is None


def test_what_was_written_last_is_read(path):
    FileStorage(path).write(b"first")
    FileStorage(path).write(DATA)
    assert FileStorage(path).read() == DATA
    assert list(path.parent.iterdir()) == [path]  # no temporary file is left


def test_the_file_can_be_read_by_people(path):
    FileStorage(path).write(b"123456789")
    # 0xCBF43926 is the check value of CRC-32 in every catalogue of CRCs.
    assert path.read_bytes() == b"hil-bench parameters 1 crc32 cbf43926\n123456789"


@given(position=st.integers(0, 65), bit=st.integers(0, 7))
def test_each_flipped_bit_is_seen(tmp_path_factory, position, bit):
    path = tmp_path_factory.getbasetemp() / "flipped.parameters"
    FileStorage(path).write(DATA)
    content = bytearray(path.read_bytes())
    content[position] ^= 1 << bit
    path.write_bytes(content)
    with pytest.raises(StorageError, match=r"flipped\.parameters: .*; mend or delete it"):
        FileStorage(path).read()


@pytest.mark.parametrize("kept", [0, 1, 20, 38, 60])
def test_a_truncated_file_is_seen(path, kept):
    FileStorage(path).write(DATA)
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(StorageError, match=r"no file of stored parameters|is damaged"):
        FileStorage(path).read()


def test_another_version_is_told(path):
    path.parent.mkdir()
    path.write_bytes(b"hil-bench parameters 2 crc32 00000000\n")
    with pytest.raises(StorageError, match="has version 2, this program reads 1"):
        FileStorage(path).read()


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(StorageError, match=r"cannot be written: (File exists|Not a directory)"):
        FileStorage(tmp_path / "file" / "valve.parameters").write(DATA)


def test_a_folder_in_place_of_the_file_is_told(path):
    path.mkdir(parents=True)
    with pytest.raises(StorageError, match="Is a directory"):
        FileStorage(path).read()
    with pytest.raises(StorageError, match="Is a directory"):
        FileStorage(path).write(DATA)
    assert list(path.parent.iterdir()) == [path]  # the temporary file is gone


def test_a_failure_while_writing_leaves_the_old_file(path, monkeypatch):
    FileStorage(path).write(b"old")

    def fail(_descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises(StorageError, match="No space left on device"):
        FileStorage(path).write(DATA)
    assert FileStorage(path).read() == b"old"
    assert list(path.parent.iterdir()) == [path]
