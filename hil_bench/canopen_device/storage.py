"""Stored parameters: their file, and the objects that store and restore them."""

import contextlib
import json
import os
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Final, Protocol
from zlib import crc32

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.eds_checks import find_faults
from hil_bench.canopen_device.emcy import GENERIC, EmcyProducer
from hil_bench.canopen_device.errors import SdoAbort, StorageError
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.object_dictionary import Access, ObjectDictionary, Variable
from hil_bench.canopen_device.pdo_parameters import MappingEntry
from hil_bench.canopen_device.service import Service

# Storage of parameters: in files, whole or not at all, and the bytes that are stored.


# Storage that survives a power cycle: a protocol, and memory as its simplest form.


class Storage(Protocol):
    """Non-volatile memory of one device: one piece of data, replaced as a whole or not at all."""

    def read(self) -> bytes | None:
        """Return the content written last; None where nothing was written.

        `StorageError` where it cannot be read or is damaged.
        """

    def write(self, data: bytes) -> None:
        """Replace what was written before; `StorageError` where that fails, the old data stay."""


class MemoryStorage:
    """Storage that lives as long as this object: for tests, and for a bench without files."""

    def __init__(self) -> None:
        self._data: bytes | None = None

    def read(self) -> bytes | None:
        """Return the content written last; None where nothing was written."""
        return self._data

    def write(self, data: bytes) -> None:
        """Replace what was written before."""
        self._data = data


# Storage in a file: replaced atomically, with a checksum that tells a damaged one.
#
# The file is one line of text, `hil-bench parameters 1 crc32 ` and eight hexadecimal digits, and
# then the data, whose CRC-32 those are. It is written beside the old one, flushed to the disk and
# renamed, so a power failure leaves either the old file or the new one.

_HEADER: Final = re.compile(rb"hil-bench parameters (\d{1,9}) crc32 ([0-9a-f]{8})\n")
_VERSION: Final = 1
_LARGEST: Final = 1 << 24
"""Size beyond which a file is none of ours [byte]."""


class FileStorage:
    """Keeps the data of one device in the file at `path`, whose folder is made when needed."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def read(self) -> bytes | None:
        """Return the content written last; None where there is no file.

        `StorageError` where it cannot be read, is damaged or of another version.
        """
        try:
            with self._path.open("rb") as file:
                content = file.read(_LARGEST + 1)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise self._error(error.strerror or str(error)) from error
        return self._check(content)

    def write(self, data: bytes) -> None:
        """Replace the file.

        Raises:
            StorageError: that failed; the old data or the new are in it.
        """
        header = f"hil-bench parameters {_VERSION} crc32 {crc32(data):08x}\n"
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._replace(header.encode() + data)
        except OSError as error:
            what = f"cannot be written: {error.strerror or error}"
            raise StorageError(f"{self._path}: {what}; what was stored before stays") from error

    def _check(self, content: bytes) -> bytes:
        header = _HEADER.match(content)
        if header is None or len(content) > _LARGEST:
            raise self._error("is no file of stored parameters")
        if int(header[1]) != _VERSION:
            raise self._error(f"has version {int(header[1])}, this program reads {_VERSION}")
        data = content[header.end() :]
        if crc32(data) != int(header[2], 16):
            raise self._error("is damaged: its checksum does not fit")
        return data

    def _replace(self, content: bytes) -> None:
        descriptor, name = tempfile.mkstemp(prefix=self._path.name, dir=self._path.parent)
        try:
            _write(descriptor, content)
            Path(name).replace(self._path)
        except OSError:
            with contextlib.suppress(OSError):
                Path(name).unlink()
            raise
        _flush_folder(self._path.parent)

    def _error(self, what: str) -> StorageError:
        right = "mend or delete it; the device runs on its defaults"
        return StorageError(f"{self._path}: {what}; {right}")


def _write(descriptor: int, content: bytes) -> None:
    """Have the content on the disk, and close the file.

    Raises:
        OSError: it is not there.
    """
    try:
        file = os.fdopen(descriptor, "wb")
    except OSError:
        os.close(descriptor)
        raise
    with file:
        file.write(content)
        file.flush()
        os.fsync(descriptor)


def _flush_folder(folder: Path) -> None:
    """Bring the renaming to the disk too; Windows does that by itself."""
    if os.name == "nt":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


# The stored parameters of a device as JSON text, which a person can read and compare.

Identity = tuple[int, int, int]
"""Vendor-ID, product code and revision number: whose parameters these are (0x1018)."""


@dataclass(frozen=True, slots=True)
class StoredParameters:
    """The contents of a device's non-volatile memory.

    Attributes:
        identity: of the device that stored them.
        node_id: node-ID that LSS stored, None where it did not.
        bit_timing: index of the bit timing that LSS stored, None where it did not.
        values: objects whose value differs from the default, by index and sub-index, as an SDO
            transfer carries them.
    """

    identity: Identity
    node_id: int | None = None
    bit_timing: int | None = None
    values: Mapping[tuple[int, int], bytes] = field(default_factory=dict)

    def encode(self) -> bytes:
        """Return the text."""
        document = {
            "identity": list(self.identity),
            "node_id": self.node_id,
            "bit_timing": self.bit_timing,
            "objects": {
                f"{index:04X}.{subindex:02X}": raw.hex()
                for (index, subindex), raw in sorted(self.values.items())
            },
        }
        return json.dumps(document, indent=1).encode() + b"\n"

    @classmethod
    def decode(cls, data: bytes) -> "StoredParameters":
        """Return the contents of a text that `encode` made.

        Raises:
            StorageError: it is another one.
        """
        try:
            document = json.loads(data)
            vendor, product, revision = map(_number, document["identity"])
            return cls(
                identity=(vendor, product, revision),
                node_id=_optional_number(document["node_id"]),
                bit_timing=_optional_number(document["bit_timing"]),
                values={
                    _multiplexer(name): bytes.fromhex(raw)
                    for name, raw in document["objects"].items()
                },
            )
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise StorageError(f"the stored parameters are malformed: {error!r}") from error


def _multiplexer(name: str) -> tuple[int, int]:
    index, subindex = name.split(".")
    return int(index, 16), int(subindex, 16)


def _number(value: object) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise TypeError(value)
    return value


def _optional_number(value: object) -> int | None:
    return None if value is None else _number(value)


# Store and restore parameters (CiA 301): 0x1010, 0x1011, and what LSS stores.
#
# The signature "save", written to 0x1010, keeps the present values of a group of objects; "load",
# written to 0x1011, forgets what was kept of it, which shows after the next reset. Sub-index 1
# means all objects, 2 those of the communication (0x1000 to 0x1FFF), 3 those of the application
# (0x6000 to 0x9FFF), 4 the manufacturer's (0x2000 to 0x5FFF).
#
# Power on and the resets set each object to what was kept, else to its default. Only what differs
# from the default is kept, so that a COB-ID that follows the node-ID goes on to do so. Process data
# are not kept: what an RPDO may write (rww), or carries at present.
#
# Stored parameters that are damaged, of another device, or make no sense together are not used: the
# device starts on its defaults and says so by EMCY 0x5530, until something is stored again.


STORAGE: Final = 0x5530
"""EMCY code: the stored parameters cannot be used (non-volatile data memory)."""

_STORE: Final = 0x1010
_RESTORE: Final = 0x1011
_SIGNATURES: Final = {
    _STORE: int.from_bytes(b"save", "little"),
    _RESTORE: int.from_bytes(b"load", "little"),
}
_ON_COMMAND: Final = 1 << 0
"""The answer of 0x1010 and 0x1011 to a read: it is done when the signature is written."""

_GROUPS: Final = {
    1: range(0x1000, 0x10000),
    2: range(0x1000, 0x2000),
    3: range(0x6000, 0xA000),
    4: range(0x2000, 0x6000),
}
_KEPT_ACCESS: Final = frozenset({Access.RW, Access.RWR})
_NOT_KEPT: Final = frozenset({0x1003, _STORE, _RESTORE, 0x1013})
_RPDO_MAPPINGS: Final = range(0x1600, 0x1800)
_HIGHEST_NODE_ID: Final = 127


class ParameterStore(Service):
    """The non-volatile memory of one device.

    Attributes:
        is_enabled: whether the NMT state allows to store and to restore.
        problem: why the stored parameters cannot be used, for people; None where they can.
        unwritten: why they could not be stored last time, for people; None where they could.
    """

    def __init__(
        self, object_dictionary: ObjectDictionary, storage: Storage, emcy: EmcyProducer
    ) -> None:
        self.is_enabled = True
        self.problem: str | None = None
        self.unwritten: str | None = None
        self._object_dictionary = object_dictionary
        self._storage = storage
        self._emcy = emcy
        self._parameters = StoredParameters(self._identity())
        self._read()
        self._watch_commands()

    @property
    def node_id(self) -> int | None:
        """The node-ID that LSS stored, None where it did not."""
        return self._parameters.node_id

    @property
    def bit_timing(self) -> int | None:
        """The index of the bit timing that LSS stored, None where it did not."""
        return self._parameters.bit_timing

    def enter(self, state: NmtState) -> None:
        """Allow to store and to restore but in OPERATIONAL, where it would hold up a machine."""
        self.is_enabled = state is not NmtState.OPERATIONAL

    def restore(self, indices: range) -> None:
        """Set the objects of `indices` to what was stored, else to their defaults."""
        self._object_dictionary.restore(indices)
        try:
            self._apply(indices)
        except StorageError as error:
            self.problem = str(error)
            self._parameters = replace(self._parameters, values={})
            self._object_dictionary.restore(indices)

    def report(self) -> None:
        """Raise the EMCY that tells of a problem, where there is one."""
        if self.problem is not None:
            self._emcy.raise_error(STORAGE, GENERIC)

    def store_layer_settings(self, node_id: int, bit_timing: int | None) -> None:
        """Keep what LSS configured; `StorageError` where that fails."""
        self._write(replace(self._parameters, node_id=node_id, bit_timing=bit_timing))

    def _identity(self) -> Identity:
        number = self._object_dictionary.number
        return number(0x1018, 1), number(0x1018, 2), number(0x1018, 3)

    def _read(self) -> None:
        try:
            data = self._storage.read()
            if data is not None:
                self._parameters = self._check(StoredParameters.decode(data))
        except StorageError as error:
            self.problem = str(error)

    def _check(self, parameters: StoredParameters) -> StoredParameters:
        if parameters.identity != self._identity():
            found, right = parameters.identity, self._identity()
            raise StorageError(f"the stored parameters are of device {found}, this one is {right}")
        node_id, bit_timing = parameters.node_id, parameters.bit_timing
        if node_id is not None and not 1 <= node_id <= _HIGHEST_NODE_ID and node_id != 0xFF:
            raise StorageError(f"the stored node-ID {node_id} is not possible")
        if bit_timing is not None and not 0 <= bit_timing <= 0xFF:
            raise StorageError(f"the stored bit timing {bit_timing} is not possible")
        return parameters

    def _write(self, parameters: StoredParameters) -> None:
        try:
            self._storage.write(parameters.encode())
        except StorageError as error:
            self.unwritten = str(error)
            raise
        self._parameters = parameters
        self.problem = self.unwritten = None
        self._emcy.clear_error(STORAGE)

    def _apply(self, indices: range) -> None:
        stored = {at: raw for at, raw in self._parameters.values.items() if at[0] in indices}
        for (index, subindex), raw in stored.items():
            variable = self._object_dictionary.find(index, subindex)
            if variable is None or not _can_be_kept(variable):
                raise StorageError(f"0x{index:04X}.{subindex:02X} is no object that can be stored")
            try:
                value = variable.data_type.decode(raw)
                variable.check_limits(value)
            except SdoAbort as abort:
                raise StorageError(f"0x{index:04X}.{subindex:02X}: {abort.text}") from abort
            variable.value = value
        for fault in find_faults(self._object_dictionary) if stored else ():
            raise StorageError(f"0x{fault.index:04X} {fault.text}")

    def _watch_commands(self) -> None:
        for index, act in ((_STORE, self._store), (_RESTORE, self._forget)):
            for subindex in range(1, self._object_dictionary.number(index) + 1):
                variable = self._object_dictionary.find(index, subindex)
                if variable is None:
                    continue
                variable.default = variable.value = _ON_COMMAND if subindex in _GROUPS else 0
                variable.add_check(partial(self._check_command, index, subindex))
                variable.add_hook(partial(_obey, variable, act))

    def _check_command(self, index: int, subindex: int, signature: int) -> None:
        """Refuse a wrong signature, and what would hold up a running machine.

        Raises:
            SdoAbort: 0800 0020 signature or group, 0800 0022 the NMT state is OPERATIONAL.
        """
        if signature != _SIGNATURES[index] or subindex not in _GROUPS:
            raise SdoAbort(*abort_codes.NOT_STORED)
        if not self.is_enabled:
            raise SdoAbort(*abort_codes.DEVICE_STATE)

    def _store(self, subindex: int) -> None:
        self._replace(subindex, dict(self._present_values(_GROUPS[subindex])))

    def _forget(self, subindex: int) -> None:
        self._replace(subindex, {})

    def _replace(self, subindex: int, values: dict[tuple[int, int], bytes]) -> None:
        others = {
            at: raw for at, raw in self._parameters.values.items() if at[0] not in _GROUPS[subindex]
        }
        try:
            self._write(replace(self._parameters, values=others | values))
        except StorageError:
            raise SdoAbort(*abort_codes.HARDWARE) from None

    def _present_values(self, indices: range) -> Iterator[tuple[tuple[int, int], bytes]]:
        process_data = self._received()
        for variable in self._object_dictionary:
            at = variable.index, variable.subindex
            is_kept = variable.index in indices and _can_be_kept(variable)
            if is_kept and at not in process_data and variable.value != variable.default:
                yield at, variable.data_type.encode(variable.value)

    def _received(self) -> set[tuple[int, int]]:
        """The objects that RPDOs carry at present, by index and sub-index."""
        number = self._object_dictionary.number
        entries = (
            MappingEntry.parse(number(index, subindex))
            for index in self._object_dictionary.indices(_RPDO_MAPPINGS)
            for subindex in range(1, number(index) + 1)
        )
        return {(entry.index, entry.subindex) for entry in entries}


def _can_be_kept(variable: Variable) -> bool:
    return variable.access in _KEPT_ACCESS and variable.index not in _NOT_KEPT


def _obey(variable: Variable, act: Callable[[int], None], _signature: int) -> None:
    """Do what the signature asks for; the object goes on to tell what it is capable of."""
    variable.value = variable.default
    act(variable.subindex)
