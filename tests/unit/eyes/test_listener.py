"""The end of a bus, as who only listens hears it."""

import can
import pytest

from hil_bench.abilities.eyes.listener import Listener
from hil_bench.abilities.hub.process import HubProcess
from hil_bench.errors import BusError


def listen_for_ever(listener):
    while True:  # pytest-timeout ends it where nothing is said
        listener.hear(0.01)


def test_a_hub_that_ends_is_a_lost_bus_and_silence_is_none():
    """It needs the real client: python-can returns None for an end of file, as for silence."""
    with HubProcess(port=0, channels=("can0",)) as hub:
        bus = can.Bus(
            interface="socketcand",
            channel="can0",
            host=hub.host,
            port=hub.port,
            ignore_config=True,
        )
        listener = Listener(bus, "can0")
        assert listener.hear(0.0) is None
    with bus, pytest.raises(BusError, match="can0: bus lost: socketcand has closed the connection"):
        listen_for_ever(listener)
