"""Who waits at the door of a server, and for how long."""

import asyncio
import resource

import pytest

from hil_bench.abilities.common.reception import WaitingRoom, capacity, say_errors_in_a_line


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


def test_the_oldest_makes_room(clock):
    gone = []
    room = WaitingRoom(gone.append, 3, 5.0, clock)
    for guest in "abcde":
        room.enter(guest)
    assert gone == ["a", "b"]
    room.leave("c")
    room.enter("f")
    assert gone == ["a", "b"]


def test_who_has_waited_too_long_goes_and_who_left_does_not(clock):
    gone = []
    room = WaitingRoom(gone.append, 3, 5.0, clock)
    room.enter("a")
    room.enter("b")
    clock.now = 3.0
    room.enter("c")
    room.leave("a")
    clock.now = 5.0
    room.look()
    assert gone == ["b"]
    room.enter("c")  # anew
    clock.now = 9.9
    room.look()
    assert gone == ["b"]


@pytest.mark.parametrize("limit", [64, 100, 1024])
def test_connections_leave_files_for_the_process_itself(monkeypatch, limit):
    """Of 64 files, 32 are kept: 10 may wait, 22 have seats; with 1024 nothing is short."""
    monkeypatch.setattr(resource, "getrlimit", lambda _: (limit, limit))
    found = {64: (22, 10), 100: (46, 22), 1024: (64, 256)}
    assert capacity(64, 256) == found[limit]


def test_what_fails_beside_all_connections_is_a_line_now_and_then(caplog):
    async def fail():
        say_errors_in_a_line("hub")
        context = {"message": "accept out of system resource", "exception": OSError(24, "many")}
        for _ in range(1000):
            asyncio.get_running_loop().call_exception_handler(dict(context))

    asyncio.run(fail())
    assert caplog.messages == ["hub: accept out of system resource: OSError(24, 'many')"]
