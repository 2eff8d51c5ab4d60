"""What the tests on a real SocketCAN bus share: the bus, a watcher of its frames, processes."""

import socket

import pytest

HOW_TO_GET_VCAN = (
    "no SocketCAN interface vcan0; run: python tests/socketcan/with_vcan.py pytest tests/socketcan"
)


@pytest.fixture(scope="session", autouse=True)
def channel():
    """The name of the interface under test; without it everything here is skipped."""
    try:
        with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as can_socket:
            can_socket.bind(("vcan0",))
    except (AttributeError, OSError):
        pytest.skip(HOW_TO_GET_VCAN)
    return "vcan0"
