"""Cost per CANopen service, frames fed directly, beside canopen.LocalNode and durand in one run.

    pip install '.[benchmark]'
    python benchmarks/services.py [--repeats N]

Every responder has the same objects, gets the same frames and must give the same answers; they take
turns, and what counts is processor time. Ours is asked for PDOs and answers after each frame. What
a round of it costs besides, once for all frames of a tick, is the last line.
"""

import argparse
import logging
import statistics
import struct
import time
from binascii import crc_hqx
from collections.abc import Callable

import occasion
from responders import FILE, KILOBYTE, TICK, Ours, Responder, responder_makers

SEGMENTS = -(-len(FILE) // 7)


def expedited_upload(responder: Responder) -> None:
    """Read 1000h."""
    responder.feed(0x605, b"\x40\x00\x10\x00\0\0\0\0")


def is_expedited_upload_right(responder: Responder) -> bool:
    """Judge the answers."""
    return responder.answers[-1][1][:4] == b"\x43\x00\x10\x00"


def expedited_download(responder: Responder) -> None:
    """Write 2000h, which has two bytes."""
    responder.feed(0x605, b"\x2b\x00\x20\x00\x07\x00\0\0")


def is_expedited_download_right(responder: Responder) -> bool:
    """Judge the answer and the object."""
    return responder.answers[-1][1][0] == 0x60 and responder.get(0x2000) == 7


SEGMENTED_UPLOAD_REQUESTS = [bytes.fromhex("4025200000000000")] + [
    bytes([0x60 | (number & 1) << 4, *bytes(7)]) for number in range(-(-len(KILOBYTE) // 7))
]


def segmented_upload(responder: Responder) -> None:
    """Read 1000 bytes in segments."""
    for request in SEGMENTED_UPLOAD_REQUESTS:
        responder.feed(0x605, request)


def is_segmented_upload_right(responder: Responder) -> bool:
    """Judge the answers."""
    segments = [
        answer[1][1:] for answer in responder.answers[-len(SEGMENTED_UPLOAD_REQUESTS) + 1 :]
    ]
    return b"".join(segments)[: len(KILOBYTE)] == KILOBYTE


def _segmented_download_requests() -> list[bytes]:
    requests = [b"\x21\x25\x20\x00" + struct.pack("<I", len(KILOBYTE))]
    for number, start in enumerate(range(0, len(KILOBYTE), 7)):
        chunk = KILOBYTE[start : start + 7]
        is_last = start + 7 >= len(KILOBYTE)
        command = (number & 1) << 4 | (7 - len(chunk)) << 1 | is_last
        requests.append(bytes([command]) + chunk.ljust(7, b"\0"))
    return requests


SEGMENTED_DOWNLOAD_REQUESTS = _segmented_download_requests()


def segmented_download(responder: Responder) -> None:
    """Write 1000 bytes in segments."""
    for request in SEGMENTED_DOWNLOAD_REQUESTS:
        responder.feed(0x605, request)


def is_segmented_download_right(responder: Responder) -> bool:
    """Judge the answers."""
    specifiers = {answer[1][0] >> 5 for answer in responder.answers[1:]}
    return len(responder.answers) == len(SEGMENTED_DOWNLOAD_REQUESTS) and specifiers == {1}


FULL_BLOCKS, LAST_BLOCK = divmod(SEGMENTS, 127)
BLOCK_UPLOAD_REQUESTS = [
    bytes.fromhex("a42120007f000000"),
    bytes([0xA3, *bytes(7)]),
    *[bytes([0xA2, 127, 127, *bytes(5)])] * FULL_BLOCKS,
    bytes([0xA2, LAST_BLOCK, 127, *bytes(5)]),
]
BLOCK_UPLOAD_END = bytes([0xA1, *bytes(7)])


def block_upload(responder: Responder) -> None:
    """Read 64 KiB in sub-blocks of 127 segments."""
    for request in BLOCK_UPLOAD_REQUESTS:
        responder.feed(0x605, request)
        responder.drain()
    responder.feed(0x605, BLOCK_UPLOAD_END)


def is_block_upload_right(responder: Responder) -> bool:
    """Judge the answers."""
    *rest, end = responder.answers
    data = b"".join(answer[1][1:] for answer in rest[-SEGMENTS:])[: len(FILE)]
    return data == FILE and end[1][1:3] == struct.pack("<H", crc_hqx(FILE, 0))


def _block_download_requests() -> list[bytes]:
    requests = [b"\xc6\x21\x20\x00" + struct.pack("<I", len(FILE))]
    for number in range(SEGMENTS):
        last = 0x80 if number == SEGMENTS - 1 else 0
        chunk = FILE[7 * number : 7 * number + 7].ljust(7, b"\0")
        requests.append(bytes([last | number % 127 + 1]) + chunk)
    unused = -len(FILE) % 7
    return [*requests, struct.pack("<BH5x", 0xC1 | unused << 2, crc_hqx(FILE, 0))]


BLOCK_DOWNLOAD_REQUESTS = _block_download_requests()


def block_download(responder: Responder) -> None:
    """Write 64 KiB in sub-blocks of 127 segments."""
    for request in BLOCK_DOWNLOAD_REQUESTS:
        responder.feed(0x605, request)


def is_block_download_right(responder: Responder) -> bool:
    """Judge the answers."""
    return responder.answers[-1][1][0] == 0xA1


def rpdo(responder: Responder) -> None:
    """Bring two values to their objects."""
    responder.feed(0x205, b"\x07\x00\x0c\xfe")


def is_rpdo_right(responder: Responder) -> bool:
    """Judge the answers."""
    return (responder.get(0x2000), responder.get(0x2001)) == (7, -500)


def sync(responder: Responder) -> None:
    """Set two objects, and have the TPDO that carries them sent by SYNC."""
    responder.put(0x2010, 7)
    responder.put(0x2011, -500)
    responder.feed(0x080, b"")


def is_sync_right(responder: Responder) -> bool:
    """Judge the PDO."""
    (answer,) = responder.answers
    return answer[0] == 0x185 and answer[1] == b"\x07\x00\x0c\xfe"


Service = tuple[str, Callable[[Responder], None], Callable[[Responder], bool], int]

SERVICES: list[Service] = [
    ("SDO expedited upload", expedited_upload, is_expedited_upload_right, 5000),
    ("SDO expedited download", expedited_download, is_expedited_download_right, 5000),
    ("SDO segmented upload, 1000 bytes", segmented_upload, is_segmented_upload_right, 50),
    (
        *("SDO segmented download, 1000 bytes", segmented_download, is_segmented_download_right),
        50,
    ),
    ("SDO block upload, 64 KiB", block_upload, is_block_upload_right, 1),
    ("SDO block download, 64 KiB", block_download, is_block_download_right, 1),
    ("RPDO, two objects", rpdo, is_rpdo_right, 5000),
    ("two objects set, SYNC, TPDO", sync, is_sync_right, 5000),
]


def does(responder: Responder, service: Service) -> bool:
    """Return True if a responder does a service at all, and rightly."""
    _, run, is_right, _ = service
    responder.forget()
    run(responder)
    try:
        return is_right(responder)
    except (IndexError, ValueError, struct.error):
        return False


def cost(responder: Responder, service: Service) -> float:
    """Return the time for one service [us]."""
    _, run, is_right, count = service
    begin = time.thread_time_ns()
    for _ in range(count):
        responder.forget()
        run(responder)
    elapsed = time.thread_time_ns() - begin
    assert is_right(responder)  # noqa: S101 - a benchmark of something else is worth nothing
    return elapsed / count / 1e3


def idle_round() -> float:
    """Return the time for a round of ours in which nothing is due [us]."""
    node = Ours().node
    emit = [].append
    count = 20_000
    begin = time.thread_time_ns()
    for _ in range(count):
        node.expire(TICK)
        node.transmit_pdos(TICK, emit)
        node.serve(TICK, emit)
    return (time.thread_time_ns() - begin) / count / 1e3


def measure(
    makers: dict[str, Callable[[], Responder]], repeats: int
) -> dict[str, dict[str, float]]:
    """Return the median times [us] by service and, of those that have it, by responder."""
    responders = {name: make() for name, make in makers.items()}
    able = {
        service: [name for name, make in makers.items() if does(make(), service)]
        for service in SERVICES
    }
    times: dict[str, dict[str, list[float]]] = {
        service[0]: {name: [] for name in names} for service, names in able.items()
    }
    for _ in range(repeats):
        for service, names in able.items():
            for name in names:
                times[service[0]][name].append(cost(responders[name], service))
    return {
        title: {name: statistics.median(values) for name, values in row.items()}
        for title, row in times.items()
    }


def main() -> None:
    """Print the figures as a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=25)
    args = occasion.arguments(parser, repeats=1)
    logging.disable(logging.CRITICAL)
    makers = responder_makers()
    times = measure(makers, args.repeats)
    print(f"medians of {args.repeats}, in turns\n")
    print(f"| service [us] | {' | '.join(makers)} | here / fastest other |")
    print(f"|---|{'---|' * len(makers)}---|")
    for title, row in times.items():
        cells = [f"{row[name]:.2f}" if name in row else "does not" for name in makers]
        fastest = min((other for name, other in row.items() if name != "here"), default=None)
        ratio = f"{row['here'] / fastest:.2f}" if fastest else "–"
        print(f"| {title} | {' | '.join(cells)} | {ratio} |")
    print(f"\nA round of a node in which nothing is due: {idle_round():.2f} us.")


if __name__ == "__main__":
    main()
