"""A SocketCAN interface and a python-can bus on it, by hand."""

import subprocess

import can
import pytest
from support.patience import GUARD


def set_link(channel, state):
    """Switch an interface "up" or "down"."""
    subprocess.run(["ip", "link", "set", channel, state], check=True)  # noqa: S603, S607 - as users do


def send(bus, can_id, data=b""):
    """Send a frame on a python-can bus."""
    bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))


def await_frame(bus, can_id):
    """Return the data of the next frame with this identifier."""
    while (message := bus.recv(timeout=GUARD)) is not None:
        if message.arbitration_id == can_id:
            return bytes(message.data)
    pytest.fail(f"no frame 0x{can_id:03X}")
