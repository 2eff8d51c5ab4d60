"""A link that plays a transcript, and time that passes while the client waits on it."""

import struct

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


@pytest.fixture
def answer(link):
    """Answers each request with registers, or with a PDU given in bytes."""

    def put(*answers):
        for given in answers:
            link.play(_Response(link, given))

    return put


class _Response(list):
    """A response that is framed when it is asked for, with the transaction of its request."""

    def __init__(self, link, given):
        super().__init__()
        self._link, self._given = link, given

    def __iter__(self):
        request = self._link.sent[-1]
        pdu = self._given
        if not isinstance(pdu, bytes):
            pdu = bytes([request[7], 2 * len(pdu)]) + struct.pack(f">{len(pdu)}H", *pdu)
        head = request[:4] + struct.pack(">HB", len(pdu) + 1, request[6])
        return iter([head + pdu])
