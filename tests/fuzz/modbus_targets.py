"""Modbus clients of the server: whatever they send, nothing is raised and the others are served."""

from fuzz.script import Script
from unit.modbus.server.conftest import Rig

from hil_bench.abilities.modbus.server.session import (
    BACKLOG,
    ModbusSession,
    serial_session,
    tcp_session,
)

MOST_STEPS = 80
READ = bytes.fromhex("0001 0000 0006 01 04 0000 0002")
ANSWER = bytes.fromhex("0001 0000 0007 01 04 04 0001 0002")

# Requests that a script may send without spelling them: a read, two writes that wait for the loop.
_KNOWN = (
    READ,
    bytes.fromhex("0002 0000 0006 01 06 0000 0007"),
    bytes.fromhex("0003 0000 0009 02 10 0000 0001 02 0005"),
    bytes.fromhex("0004 0000 0006 01"),
)


def _piece(script: Script, kind: int) -> bytes:
    known = _KNOWN[kind >> 2 & 3] if kind & 0x10 else b""
    return known + (script.take(script.number() % 64) if kind & 0x20 else b"")


def modbus_tcp(data: bytes) -> None:
    """Three connections to one server, a loop that ticks at any time, and ends in between."""
    script, rig = Script(data), Rig()
    written: list[list[bytes]] = [[], [], []]
    sessions = [tcp_session(rig.server, answers.append) for answers in written]
    for kind in script.steps(MOST_STEPS):
        number = kind % 3
        if kind & 0x40:
            rig.tick(code=kind >> 2 & 1)
        if kind & 0x80:
            rig.now += 0.3
            rig.server.poll()
        if kind & 0xF0 == 0xF0:
            sessions[number].end()
            written[number] = []
            sessions[number] = tcp_session(rig.server, written[number].append)
        if not sessions[number].is_full:
            sessions[number].receive(_piece(script, kind))
        assert len(sessions[number]._buffer) < BACKLOG + 300
    _serve_an_honest_client(rig)


def _serve_an_honest_client(rig: Rig) -> None:
    """Nothing that the others did keeps a new client from its answer."""
    rig.tick(65538.0, 7.0, -1.0, 8.0)
    rig.server.poll()
    answers: list[bytes] = []
    tcp_session(rig.server, answers.append).receive(READ)
    assert answers == [ANSWER]


def modbus_rtu(data: bytes) -> None:
    """A serial line with noise on it, and silence at times."""
    script, rig = Script(data), Rig()
    written: list[bytes] = []
    session: ModbusSession = serial_session(rig.server, written.append)
    for kind in script.steps(MOST_STEPS):
        session.receive(script.take(kind & 0x3F))
        if kind & 0x40:
            rig.tick()
            rig.server.poll()
        if kind & 0x80:
            session.drop()
        assert len(session._buffer) < BACKLOG + 300
    assert not session.is_over
    _serve_an_honest_client(rig)
