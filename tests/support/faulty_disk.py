"""A disk that fails at one I/O call of a program: what a full, broken or slow one does to it."""

import contextlib
import errno
import io
import os
import pathlib
import tempfile
from enum import Enum

_WRITE = "write"


class Fault(Enum):
    """What happens at the chosen call."""

    BROKEN = errno.EIO
    FORBIDDEN = errno.EACCES
    INTERRUPTED = errno.EINTR
    FULL = errno.ENOSPC
    """Half of what is to be written is, and from then on nothing more."""
    SHORT = 0
    """Half of what is to be written is, and the caller has to write the rest."""


class FaultyDisk:
    """Counts the calls that concern files below a folder, and lets one of them fail.

    Attributes:
        calls: names of the calls of the last `failing` block.
        descriptors: those that are open.
    """

    def __init__(self, monkeypatch, folder):
        self._folder = folder
        self._fault = self._at = None
        self._is_full = False
        self.calls = []
        self.descriptors = set()
        for name in ("stat", "replace", "mkdir", "unlink"):
            monkeypatch.setattr(pathlib.Path, name, self._path_call(name))
        for name in ("fsync", "fstat", "close"):
            monkeypatch.setattr(os, name, self._descriptor_call(name))
        monkeypatch.setattr(pathlib.Path, "open", self._open_path(pathlib.Path.open))
        monkeypatch.setattr(os, "open", self._open(os.open))
        monkeypatch.setattr(os, "fdopen", self._fdopen(os.fdopen))
        monkeypatch.setattr(tempfile, "mkstemp", self._mkstemp(tempfile.mkstemp))

    @contextlib.contextmanager
    def failing(self, fault, at):
        """Let the call with this number fail, from 0, for the time of the block."""
        self.calls.clear()
        self._fault, self._at, self._is_full = fault, at, False
        try:
            yield
        finally:
            self._at = None

    def call(self, name, function, data=None):
        """Make a call, or fail."""
        arguments = () if data is None else (data,)
        if self._at is None:
            return function(*arguments)
        self.calls.append(name)
        if len(self.calls) - 1 != self._at and not (self._is_full and name == _WRITE):
            return function(*arguments)
        if self._fault in {Fault.FULL, Fault.SHORT}:
            if name != _WRITE:
                self._at += 1  # the next call may write
                return function(*arguments)
            half, is_first = data[: len(data) // 2], not self._is_full
            self._is_full = self._fault is Fault.FULL
            if is_first and len(half):
                return function(half)
            if self._fault is Fault.SHORT:
                return function(data)
        raise OSError(self._fault.value, os.strerror(self._fault.value))

    def _concerns(self, path):
        return self._folder in (path, *path.parents)

    def _path_call(self, name):
        real = getattr(pathlib.Path, name)

        def call(path, *args, **options):
            if not self._concerns(path):
                return real(path, *args, **options)
            return self.call(name, lambda: real(path, *args, **options))

        return call

    def _descriptor_call(self, name):
        real = getattr(os, name)

        def call(descriptor):
            if descriptor not in self.descriptors:
                return real(descriptor)
            if name != "close":
                return self.call(name, lambda: real(descriptor))
            self.descriptors.discard(descriptor)
            real(descriptor)  # which close(2) does even where it reports an error
            return self.call(name, lambda: None)

        return call

    def _open_path(self, real):
        def open_path(path, mode="r", *args, **options):
            if not self._concerns(path) or mode != "wb":
                return real(path, mode, *args, **options)
            return self._file(self.call("open", lambda: real(path, mode, *args, **options)))

        return open_path

    def _open(self, real):
        def open_descriptor(path, *args, **options):
            if not isinstance(path, pathlib.Path) or not self._concerns(path):
                return real(path, *args, **options)
            descriptor = self.call("open", lambda: real(path, *args, **options))
            self.descriptors.add(descriptor)
            return descriptor

        return open_descriptor

    def _fdopen(self, real):
        def fdopen(descriptor, mode):
            if descriptor not in self.descriptors:
                return real(descriptor, mode)
            raw = self.call("fdopen", lambda: real(descriptor, mode, buffering=0))
            return io.BufferedWriter(self._file(raw))

        return fdopen

    def _mkstemp(self, real):
        def mkstemp(**options):
            if not self._concerns(pathlib.Path(options["dir"])):
                return real(**options)
            descriptor, name = self.call("mkstemp", lambda: real(**options))
            self.descriptors.add(descriptor)
            return descriptor, name

        return mkstemp

    def _file(self, file):
        self.descriptors.add(file.fileno())
        return _File(self, file)


class _File(io.RawIOBase):
    """An unbuffered file whose calls may fail."""

    def __init__(self, disk, file):
        self._disk = disk
        self._file = file

    def writable(self):
        return True

    def write(self, data):
        return self._disk.call(_WRITE, self._file.write, memoryview(data))

    def seek(self, address, whence=os.SEEK_SET):
        return self._disk.call("seek", lambda: self._file.seek(address, whence))

    def truncate(self, size=None):
        return self._disk.call("truncate", lambda: self._file.truncate(size))

    def fileno(self):
        return self._file.fileno()

    def close(self):
        if self.closed:
            return
        super().close()
        self._disk.descriptors.discard(self._file.fileno())
        self._file.close()  # which close(2) does even where it reports an error
        self._disk.call("close", lambda: None)
