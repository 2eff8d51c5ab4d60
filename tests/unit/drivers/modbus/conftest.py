"""A link that plays a transcript, and time that passes while the client waits on it."""

import pytest

from hil_drivers.modbus import ModbusClient
from hil_drivers.modbus.framing import TcpFraming


class TranscriptLink:
    """Gives for each request what the test says, in virtual time."""

    def __init__(self, framing):
        self.description = "transcript"
        self.framing = framing
        self.time = 100.0
        self.answers = []
        self.sent = []
        self.opened = 0
        self.refuses = False
        self._pieces = []

    def now(self):
        return self.time

    def play(self, *answers):
        """The response to each further request: bytes, pieces in a list, None, or an error."""
        self.answers.extend(answers)

    def open(self, _timeout):
        if self.refuses:
            raise ConnectionRefusedError(111, "Connection refused")
        self.opened += 1

    def close(self):
        pass

    def send(self, data):
        self.sent.append(bytes(data))
        answer = self.answers.pop(0) if self.answers else None
        if isinstance(answer, OSError):
            raise answer
        self._pieces = list(answer) if isinstance(answer, list) else [answer or b""]

    def receive(self, timeout):
        if self._pieces and (piece := self._pieces.pop(0)):
            if isinstance(piece, OSError):
                raise piece
            return piece
        self.time += timeout
        return b""

    def wait(self, duration):
        self.time += duration


@pytest.fixture
def link():
    return TranscriptLink(TcpFraming())


@pytest.fixture
def client(link):
    return ModbusClient(link, clock=link.now)
