"""What Wireshark's CANopen dissector reads in recorded frames."""

import os
import shutil
import struct
import subprocess

import pytest

_CAN_SOCKETCAN = 227  # link type of libpcap's registry: a SocketCAN frame, identifier big-endian
_EXTENDED, _REMOTE = 1 << 31, 1 << 30


def require_tshark():
    """Skip where there is no tshark; fail in CI, whose machines must have it."""
    if shutil.which("tshark") is None:
        reason = "no tshark; apt-get install tshark"
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)


def write_capture(path, frames):
    """Write (time [s], frame) pairs as a capture file (libpcap)."""
    with path.open("wb") as file:
        file.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, _CAN_SOCKETCAN))
        for time, frame in frames:
            can_id = frame.can_id | frame.is_extended * _EXTENDED | frame.is_remote * _REMOTE
            raw = struct.pack(">IB3x", can_id, len(frame.data)) + frame.data.ljust(8, b"\0")
            seconds, microseconds = divmod(round(time * 1e6), 1_000_000)
            file.write(struct.pack("<IIII", seconds, microseconds, len(raw), len(raw)) + raw)


def dissect(path, *fields, only=""):
    """Return these fields of each frame of a capture or a candump log, as tshark prints them.

    Args:
        path: the file.
        fields: by tshark's names.
        only: a display filter.
    """
    command = ["tshark", "-n", "-r", str(path), "-d", "can.subdissector,canopen", "-T", "fields"]
    if only:
        command += ["-Y", only]
    for field in fields:
        command += ["-e", field]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=50)
    return [tuple(row.split("\t")) for row in done.stdout.splitlines()]
