"""Bytes a processor second through the J1939 transport protocol, against `can-j1939`.

    python benchmarks/j1939_transport.py [--messages N] [--repeats N]

Two ends of the same library hand each other messages of 1785 bytes by RTS/CTS, 16
packets a CTS, in one process, without a bus, a thread or a wait. The two libraries alternate; the
fastest round of each counts.
"""

import argparse
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from j1939.j1939_21 import J1939_21

import occasion
from hil_bench.abilities.j1939.protocol.ecu import Ecu
from hil_bench.abilities.j1939.protocol.signals import Name
from hil_bench.abilities.j1939.protocol.transmission import MOST_BYTES

if TYPE_CHECKING:
    from hil_bench.canopen_device.frame import Frame

GROUP, OURS, THEIRS = 0xEF00, 100, 101
MESSAGE = bytes(number % 251 for number in range(MOST_BYTES))


def run_ours(messages: int) -> int:
    """Send messages between two of our ECUs; return the bytes that arrived."""
    sender, receiver = Ecu(Name(1), OURS), Ecu(Name(2), THEIRS)
    arrived = 0

    def take(_source: int, data: bytes, _now: int) -> None:
        nonlocal arrived
        arrived += len(data)

    receiver.take(GROUP, take)
    for ecu in (sender, receiver):
        ecu.start(0)
    for _ in range(messages):
        sender.send(GROUP, MESSAGE, THEIRS)
        frames: list[Frame] = []
        sender.serve(0, frames.append)
        while frames:
            answers: list[Frame] = []
            for frame in frames:
                receiver.receive(frame, 0)
            receiver.serve(0, answers.append)
            frames = []
            for frame in answers:
                sender.receive(frame, 0)
            sender.serve(0, frames.append)
    return arrived


def run_theirs(messages: int) -> int:
    """Send messages between two of their data link layers; return the bytes that arrived."""
    queue: list[tuple[int, bytes]] = []
    arrived = 0

    def notify(
        _priority: int, _group: int, _source: int, _to: int, _time: float, data: bytes
    ) -> None:
        nonlocal arrived
        arrived += len(data)

    def make(address: int) -> J1939_21:
        def put(can_id: int, _is_extended: bool, data: bytes) -> None:
            queue.append((can_id, data))

        return J1939_21(put, lambda: None, notify, 16, None, None, lambda to: to == address)

    ends = {OURS: make(OURS), THEIRS: make(THEIRS)}
    for _ in range(messages):
        ends[OURS].send_pgn(0, 0xEF, THEIRS, 6, OURS, list(MESSAGE), 0, None)
        for _ in range(100):
            frames = queue.copy()
            queue.clear()
            for can_id, data in frames:
                ends[can_id >> 8 & 0xFF].notify(can_id, bytearray(data), 0.0)
            ends[OURS].async_job_thread(time.time() + 1e-6)  # noqa: TID251 - their clock
            if not queue:
                break
    return arrived


def measure(run: Callable[[int], int], messages: int) -> float:
    """Return bytes a processor second.

    Raises:
        SystemExit: not all bytes arrived.
    """
    start = time.process_time()
    arrived = run(messages)
    if arrived != messages * MOST_BYTES:
        raise SystemExit(f"{arrived} bytes of {messages * MOST_BYTES} arrived")
    return arrived / (time.process_time() - start)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--messages", type=int, default=200)
    parser.add_argument("--repeats", type=int, default=5)
    args = occasion.arguments(parser, messages=2, repeats=1)
    rounds = [
        (measure(run_ours, args.messages), measure(run_theirs, args.messages))
        for _ in range(args.repeats)
    ]
    ours, theirs = (max(column) for column in zip(*rounds, strict=True))
    print(f"this bench  {ours / 1e6:6.2f} MB a processor second")
    print(f"can-j1939   {theirs / 1e6:6.2f} MB a processor second")
    print(f"ratio       {ours / theirs:6.2f}")


if __name__ == "__main__":
    main()
