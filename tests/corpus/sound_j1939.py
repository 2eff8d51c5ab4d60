"""Additions to a sound J1939 log that are no faults: `explain` has to find nothing in it."""

from collections.abc import Callable, Iterator

from corpus.faults import MS, Frames, Scene, merged, tried
from corpus.j1939_scene import CLAIMED, NOBODY, Session, cyclic, frame, name_of, pair, senders
from corpus.logs import SoundLog
from hil_bench.canopen_device.frame import Frame

Made = Frames | None
VARIANTS: dict[str, Callable[[Scene], Made]] = {}


def variant(make: Callable[[Scene], Made]) -> Callable[[Scene], Made]:
    """Register a function as a variant."""
    VARIANTS[make.__name__] = make
    return make


def variant_of(log: SoundLog, name: str) -> SoundLog | None:
    """Return a sound variant of a sound log; None where it does not fit."""
    made = tried(VARIANTS[name], log, name)
    return log._replace(name=f"{log.name}:{name}", frames=tuple(made)) if made else None


def variants(log: SoundLog) -> Iterator[SoundLog]:
    """Yield the sound variants of a sound log that fit it."""
    for name in sorted(VARIANTS):
        made = variant_of(log, name)
        if made is not None:
            yield made


@variant
def recording_begins_late(scene: Scene) -> Made:
    """The start is not in the log."""
    since = int(scene.end * scene.share(0.2, 0.5))
    return [e._replace(now=e.now - since) for e in scene.frames if e.now >= since]


@variant
def recording_ends_early(scene: Scene) -> Made:
    """The end is not in the log."""
    until = int(scene.end * scene.share(0.4, 0.9))
    return [e for e in scene.frames if e.now <= until]


@variant
def foreign_frames_between(scene: Scene) -> Made:
    """Frames of 29 bits of another protocol, and some of 11 bits, are on the same bus."""
    added, now = [], 500 * MS
    while now + 130 * MS < scene.end:
        now += int(scene.share(5, 120) * MS)
        data = scene.random.randbytes(scene.random.randrange(9))
        base = scene.random.choice((0x1F400000, 0x1E2A0000, 0x15550000))
        added.append((now, Frame(base | scene.random.randrange(1 << 16), data, is_extended=True)))
        added.append((now + 1 * MS, Frame(0x3C0 + scene.random.randrange(8), data)))
    return merged(scene.frames, added)


@variant
def newcomer_takes_another_address(scene: Scene) -> Made:
    """A device wants an address that is taken, is warded off, and claims a free one."""
    found = senders(scene)
    if not found or scene.end < 4000 * MS:
        return None
    owner, at = scene.random.choice(found), int(scene.end * scene.share(0.2, 0.6))
    name = name_of(scene, owner)
    greater = bytes([*name[:3], 0xFF, *name[4:7], 0xA0])
    if int.from_bytes(greater, "little") <= int.from_bytes(name, "little"):
        return None
    free = next(a for a in range(200, 248) if a not in found)
    added = [
        (at, frame(CLAIMED, owner, greater)),
        (at + 2 * MS, frame(CLAIMED, owner, name)),
        (at + 4 * MS, frame(CLAIMED, free, greater)),
    ]
    cycle = range(at + 260 * MS, scene.end, 200 * MS)
    return merged(scene.frames, added + [(t, frame(0xFF77, free, bytes(8))) for t in cycle])


@variant
def tool_asks_for_claims_and_signs_off(scene: Scene) -> Made:
    """A tool asks all for their addresses, claims one, asks what nobody has, and signs off."""
    found = senders(scene)
    if not found or scene.end < 4000 * MS:
        return None
    at, name = int(scene.end * scene.share(0.2, 0.5)), b"\x07\x01\x20\x0c\0\x81\0\x80"
    added = [(at, frame(0xEA00, NOBODY, b"\x00\xee\x00"))]
    added += [
        (at + (3 + k) * MS, frame(CLAIMED, a, name_of(scene, a))) for k, a in enumerate(found)
    ]
    added += [
        (at + 300 * MS, frame(CLAIMED, 251, name)),
        (at + 600 * MS, frame(0xEA00, 251, b"\xda\xfd\x00")),
        (at + 1600 * MS, frame(CLAIMED, NOBODY, name)),
    ]
    return merged(scene.frames, added)


@variant
def packets_are_asked_for_again(scene: Scene) -> Made:
    """A packet is lost on the way to the receiver, which asks for it again by a CTS."""
    found = pair(scene, 3000 * MS)
    session = Session(found[0], found[1], 80, found[2])
    session.announce().wait(3).clear(session.count, 1).packets(range(1, session.count + 1), 6)
    session.wait(4).clear(2, 5).packets(range(5, 7), 6).wait(3).end()
    return merged(scene.frames, session.frames)


@variant
def message_begins_and_ends_with_a_function(scene: Scene) -> Made:
    """A command to one device comes each 50 ms while a function is active, twice."""
    found = senders(scene)
    if len(found) < 2 or scene.end < 6000 * MS:
        return None
    command = frame(0x0000, found[0], b"\x01\xff\xff\x7d\xff\xff\xff\xff", found[1], 3)
    begins = (int(scene.end * 0.2), int(scene.end * 0.6))
    return merged(
        scene.frames, [(t, command) for b in begins for t in range(b, b + 1000 * MS, 50 * MS)]
    )


@variant
def message_on_change(scene: Scene) -> Made:
    """A message comes at each change of its value, and each second otherwise."""
    if not cyclic(scene):
        return None
    source, now, added = 201, 700 * MS, []
    while now < scene.end:
        added.append((now, frame(0xFF78, source, scene.random.randbytes(2) + b"\xff" * 6)))
        now += scene.random.choice((20, 35, 90, 300, 1000, 1000)) * MS
    return merged(scene.frames, added)


@variant
def signal_becomes_available(scene: Scene) -> Made:
    """A signal is "not available" at first and has values from some time on."""
    since = int(scene.end * scene.share(0.2, 0.5))
    found = {c.can_id for c in cyclic(scene) if c.can_id >> 8 & 0xFFFF in {0xFEEE, 0xFEF1, 0xF003}}
    if not found:
        return None
    return [
        e._replace(frame=e.frame._replace(data=b"\xff" * 8))
        if e.frame.can_id in found and e.now < since
        else e
        for e in scene.frames
    ]


@variant
def receiver_says_wait_and_goes_on(scene: Scene) -> Made:
    """A receiver says "wait" each half second, and takes the message then."""
    found = pair(scene, 5000 * MS)
    session = Session(found[0], found[1], 60, found[2]).announce()
    for _ in range(3):
        session.wait(scene.share(300, 500)).clear(0, 0xFF)
    session.wait(400).clear(session.count, 1).packets(range(1, session.count + 1), 8)
    return merged(scene.frames, session.wait(5).end().frames)


@variant
def device_is_commanded_to_another_address(scene: Scene) -> Made:
    """A tool commands a device to another address (BAM of 9 bytes), from which it goes on."""
    found = senders(scene)
    if not found or scene.end < 5000 * MS:
        return None
    one, at = scene.random.choice(found), int(scene.end * scene.share(0.3, 0.5))
    name, free = name_of(scene, one), next(a for a in range(210, 248) if a not in found)
    command = Session(249, 255, 9, at, 0xFED8).announce()
    data = name + bytes([free]) + b"\xff" * 5
    packets = [
        (at + k * 60 * MS, frame(0xEB00, 249, bytes([k]) + data[7 * k - 7 : 7 * k], 255, 7))
        for k in (1, 2)
    ]
    moved = at + 150 * MS
    frames = [
        e._replace(frame=e.frame._replace(can_id=e.frame.can_id & ~0xFF | free))
        if e.now > moved and e.frame.is_extended and e.frame.can_id & 0xFF == one
        else e
        for e in scene.frames
    ]
    taken = any(e.frame.is_extended and e.frame.can_id >> 8 & 0xFF == one for e in scene.frames)
    if taken:  # others speak to it at its address
        return None
    claim = (moved, frame(CLAIMED, free, name))
    return merged(frames, [*command.frames, *packets, claim])
