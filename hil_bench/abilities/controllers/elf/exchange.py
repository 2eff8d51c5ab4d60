"""Messages between the bench and the process that simulates a chip: one of each a tick."""

import socket
from collections.abc import Sequence
from enum import IntEnum
from struct import Struct
from typing import Final, NamedTuple

from hil_bench.abilities.controllers.seam import TimedFrame, make_timed
from hil_bench.canopen_device.frame import Frame, make_frame

LARGEST: Final = 1 << 26
"""Of a message [byte]."""

_SIZE: Final = Struct("<I")
_AT_ONCE: Final = 1 << 16
_REQUEST: Final = Struct("<BqI")
_ANSWER: Final = Struct("<BqII")
_FRAME: Final = Struct("<qIBBB8s")
_EXTENDED: Final = 1
_REMOTE: Final = 2
AWAKE: Final = -1
"""In place of the time to which a chip sleeps."""


class Order(IntEnum):
    """An order of the bench."""

    ADVANCE = 0
    POWER_CYCLE = 1
    BRANCH = 2


class State(IntEnum):
    """The state of a chip at the end of a request."""

    RUNNING = 0
    FAILED = 1


_ORDERS, _STATES = tuple(Order), tuple(State)  # by number, quicker than a call of the class


class Answer(NamedTuple):
    """The words of a chip.

    Attributes:
        state: of it.
        wake: the time to which it sleeps unless a frame comes [ns], or `AWAKE`.
        sent: frames.
        text: that it has printed; the last line says why it has failed.
    """

    state: State
    wake: int
    sent: list[TimedFrame]
    text: str


def send_message(link: socket.socket, message: bytes) -> None:
    """Send a message; an `OSError` says that nobody is there."""
    link.sendall(_SIZE.pack(len(message)) + message)


def receive_message(link: socket.socket) -> bytes:
    """Return the next message; empty where the other side is gone.

    Raises:
        ConnectionError: what comes is no message.
    """
    data = b""
    end = _SIZE.size
    while len(data) < end:
        more = link.recv(_AT_ONCE)
        if not more:
            return b""
        data += more
        if end == _SIZE.size <= len(data):
            (size,) = _SIZE.unpack_from(data)
            if size > LARGEST:
                raise ConnectionError(f"a message of {size} bytes, more than {LARGEST}")
            end += size
    return data[_SIZE.size :]


def pack_request(order: Order, time: int, frames: Sequence[TimedFrame]) -> bytes:
    """Return a request as bytes."""
    return _REQUEST.pack(order, time, len(frames)) + _pack(frames)


def unpack_request(message: bytes) -> tuple[Order, int, list[TimedFrame]]:
    """Return order, time [ns] and frames of a request."""
    order, time, count = _REQUEST.unpack_from(message)
    return _ORDERS[order], time, _unpack(message, _REQUEST.size, count)


def pack_answer(answer: Answer) -> bytes:
    """Return an answer as bytes."""
    text = answer.text.encode()
    head = _ANSWER.pack(answer.state, answer.wake, len(answer.sent), len(text))
    return head + _pack(answer.sent) + text


def unpack_answer(message: bytes) -> Answer:
    """Return an answer of its bytes."""
    state, wake, count, size = _ANSWER.unpack_from(message)
    sent = _unpack(message, _ANSWER.size, count) if count else []
    text = message[len(message) - size :].decode() if size else ""
    return Answer(_STATES[state], wake, sent, text)


def _pack(frames: Sequence[TimedFrame]) -> bytes:
    return b"".join(
        _FRAME.pack(
            time,
            frame.can_id,
            frame.is_extended * _EXTENDED | frame.is_remote * _REMOTE,
            frame.bus,
            len(frame.data),
            frame.data,
        )
        for time, frame in frames
    )


def _unpack(message: bytes, at: int, count: int) -> list[TimedFrame]:
    end = at + count * _FRAME.size
    found: list[TimedFrame] = []
    for time, can_id, flags, bus, size, data in _FRAME.iter_unpack(message[at:end]):
        is_remote, is_extended = bool(flags & _REMOTE), bool(flags & _EXTENDED)
        frame = make_frame(Frame, (can_id, data[:size], is_remote, is_extended, bus, 0))
        found.append(make_timed(TimedFrame, (time, frame)))
    return found
