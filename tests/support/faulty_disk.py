"""A disk that fails at one I/O call of a program: what a full, broken or slow one does to it."""

import contextlib
import errno
import os
import pathlib
from enum import Enum

_HALVED = "write"


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
        calls: names of the calls so far.
        open_files: files that are open.
    """

    def __init__(self, monkeypatch, folder):
        self._folder = folder
        self._fault = self._at = None
        self._is_full = False
        self.calls = []
        self.open_files = set()
        for name in ("stat", "replace", "mkdir"):
            monkeypatch.setattr(pathlib.Path, name, self._path_call(name))
        monkeypatch.setattr(pathlib.Path, "open", self._open(pathlib.Path.open))
        for name in ("fsync", "fstat"):
            monkeypatch.setattr(os, name, self._descriptor_call(name))

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
        if self._at is None:
            return function() if data is None else function(data)
        self.calls.append(name)
        if len(self.calls) - 1 != self._at and not (self._is_full and name == _HALVED):
            return function() if data is None else function(data)
        if self._fault in {Fault.FULL, Fault.SHORT}:
            if name != _HALVED:
                self._at += 1  # the next call may write
                return function()
            if self._fault is Fault.SHORT:
                return function(data[: max(1, len(data) // 2)])
            half = 0 if self._is_full else len(data) // 2
            self._is_full = True
            if half:
                return function(data[:half])
        raise OSError(self._fault.value, os.strerror(self._fault.value))

    def _concerns(self, path):
        return self._folder in path.parents

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
            if descriptor not in {file.fileno() for file in self.open_files}:
                return real(descriptor)
            return self.call(name, lambda: real(descriptor))

        return call

    def _open(self, real):
        def open_path(path, mode="r", *args, **options):
            if not self._concerns(path) or mode != "wb":
                return real(path, mode, *args, **options)
            file = self.call("open", lambda: real(path, mode, *args, **options))
            return _File(self, file)

        return open_path


class _File:
    def __init__(self, disk, file):
        self._disk = disk
        self._file = file
        disk.open_files.add(file)

    def write(self, data):
        return self._disk.call("write", self._file.write, data)

    def seek(self, address):
        return self._disk.call("seek", lambda: self._file.seek(address))

    def truncate(self, size):
        return self._disk.call("truncate", lambda: self._file.truncate(size))

    def fileno(self):
        return self._file.fileno()

    def close(self):
        self._disk.open_files.discard(self._file)
        self._file.close()  # as close(2) does, even where it reports an error
        self._disk.call("close", lambda: None)
