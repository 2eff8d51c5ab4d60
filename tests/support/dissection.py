"""What Wireshark's CANopen dissector reads in recorded frames."""

import os
import shutil
import struct
import subprocess

import pytest

_CAN_SOCKETCAN = 227  # link type of libpcap's registry: a SocketCAN frame, identifier big-endian
_RAW_IPV4 = 228  # an IPv4 packet
_CLIENT, _SERVER = (bytes([127, 0, 0, 1]), 40000), (bytes([127, 0, 0, 1]), 502)
_EXTENDED, _REMOTE = 1 << 31, 1 << 30


def require_tshark():
    """Skip where there is no tshark; fail in CI, whose machines must have it."""
    require_tool("tshark")


def require_tool(name, package=""):
    """Skip where there is no such program; fail in CI, whose machines must have it."""
    if shutil.which(name) is None:
        reason = f"no {name}; apt-get install {package or name}"
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


def write_tcp_capture(path, messages):
    """Write (is_request, bytes) pairs as the segments of one TCP connection to port 502."""
    sent = {True: 1, False: 1}
    with path.open("wb") as file:
        file.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, _RAW_IPV4))
        for number, (is_request, data) in enumerate(messages):
            (source, source_port), (target, target_port) = (
                (_CLIENT, _SERVER) if is_request else (_SERVER, _CLIENT)
            )
            numbers = sent[is_request], sent[not is_request]
            tcp = struct.pack(">HHIIHHHH", source_port, target_port, *numbers, 0x5018, 65535, 0, 0)
            head = struct.pack(">BBHHHBBH", 0x45, 0, 40 + len(data), number, 0, 64, 6, 0)
            raw = head + source + target + tcp + data
            file.write(struct.pack("<IIII", 0, number * 1000, len(raw), len(raw)) + raw)
            sent[is_request] += len(data)


def dissect(path, *fields, only="", decode_as="can.subdissector,canopen"):
    """Return these fields of each frame of a capture or a candump log, as tshark prints them.

    Args:
        path: the file.
        fields: by tshark's names.
        only: a display filter.
        decode_as: what tshark's -d says.
    """
    command = ["tshark", "-n", "-r", str(path), "-d", decode_as, "-T", "fields"]
    if only:
        command += ["-Y", only]
    for field in fields:
        command += ["-e", field]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return [tuple(row.split("\t")) for row in done.stdout.splitlines()]
