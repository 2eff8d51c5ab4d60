"""Kinds of J1939 faults that `explain` had not met when it had been mended by the others."""

from corpus.faults import MS, Found, Scene, fault_of_j1939, merged
from corpus.j1939_scene import (
    ALL,
    CLAIMED,
    CONTROL,
    Added,
    Blamed,
    Session,
    cyclic,
    drawn,
    fault_of_a_transfer,
    frame,
    is_from,
    name_of,
    one_of_several,
    senders,
)
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.canopen_device.frame import Frame

_DM1 = 0xFECA


@fault_of_j1939(Cause.J1939_SILENT)
def device_is_away_for_a_while(scene: Scene) -> Found:
    """A device sends nothing for a while and goes on without a claim, as after bus-off."""
    found = [e for e in cyclic(scene) if e.period <= 200 * MS]
    sources = [e.source for e in found]
    fast = [e for e in found if sources.count(e.source) > 1]  # else it is a message that stays out
    if not fast or len(senders(scene)) < 2 or scene.end < 7000 * MS:
        return None
    gone = scene.random.choice(fast).source
    since = int(scene.end * scene.share(0.3, 0.5))
    until = since + int(scene.share(1300, 3000)) * MS
    return scene.without(lambda e: since < e.now < until and is_from(e, gone)), f"{gone}"


@fault_of_j1939(Cause.J1939_SILENT)
def two_devices_vanish_together(scene: Scene) -> Found:
    """Two devices of several send nothing from one time on: a branch without supply."""
    found = sorted({c.source for c in cyclic(scene) if c.period <= 1000 * MS})
    if len(found) < 3 or scene.end < 8000 * MS:
        return None
    gone, since = scene.random.sample(found, 2), int(scene.end * scene.share(0.3, 0.5))
    frames = scene.without(lambda e: e.now > since and any(is_from(e, g) for g in gone))
    return frames, f"{gone[0]}|{gone[1]}"


@fault_of_j1939(Cause.ADDRESS_CLASH)
def device_of_another_name_at_an_address(scene: Scene) -> Found:
    """A second device of a smaller NAME claims an address in use; the first one goes on sending."""
    owner = one_of_several(scene, 5000 * MS)
    number = int.from_bytes(name_of(scene, owner), "little")
    other = (number ^ 0x1F if number & 0x1F else number + 5).to_bytes(8, "little")
    at = int(scene.end * scene.share(0.2, 0.5))
    return merged(scene.frames, [(at, frame(CLAIMED, owner, other))]), f"{owner}"


@fault_of_j1939(Cause.J1939_PERIOD)
def message_comes_in_bursts(scene: Scene) -> Found:
    """A message is held back and comes in bursts of four from some time on."""
    message = drawn(scene, 40)
    since = int(scene.end * scene.share(0.35, 0.5))
    late = [t for t in message.times if t > since]
    last = {t: late[min(k // 4 * 4 + 3, len(late) - 1)] for k, t in enumerate(late)}
    frames = [
        e._replace(now=last[e.now] + (late.index(e.now) % 4) * MS // 2)
        if e.frame.can_id == message.can_id and e.now in last
        else e
        for e in scene.frames
    ]
    return sorted(frames, key=lambda e: e.now), f"{message.source}"


@fault_of_a_transfer(3000)
def announcement_contradicts_itself(scene: Scene, session: Session) -> Blamed:
    """An RTS has more packets than its bytes need; the receiver aborts it."""
    session.count += 1 + scene.random.randrange(3)
    session.announce().wait(scene.share(1, 20)).abort(session.b, 250)
    return f"{session.a}|{session.b}"


@fault_of_a_transfer(3000, shortest=40)
def end_of_message_comes_too_soon(_: Scene, session: Session) -> Blamed:
    """The receiver says that it has a message of which half of the packets have not been sent."""
    session.announce().wait(4).clear(session.count, 1)
    session.packets(range(1, session.count // 2 + 1), 5).wait(3).end()
    return f"{session.a}|{session.b}"


@fault_of_j1939(Cause.TROUBLE_CODE)
def codes_by_broadcast(scene: Scene) -> Found:
    """A device reports three codes by DM1, which takes a BAM each second."""
    source = one_of_several(scene, 5000 * MS)
    busy = any(
        e.frame.is_extended
        and e.frame.can_id >> 16 & 0xFF in {0xEB, 0xEC}
        and is_from(e, source or 0)
        for e in scene.frames
    )
    if busy:
        return None
    codes = [(int(scene.share(20, 4000)) + k, 2 + k) for k in range(3)]
    data = bytes([0x04, 0xFF]) + b"".join(
        bytes([spn & 0xFF, spn >> 8, fmi, 1]) for spn, fmi in codes
    )
    added: Added = []
    for now in range(int(scene.end * scene.share(0.1, 0.4)), scene.end - 300 * MS, 1000 * MS):
        head = bytes([32, len(data), 0, 2, 0xFF]) + _DM1.to_bytes(3, "little")
        added.append((now, frame(CONTROL, source, head, ALL, 7)))
        for k in (1, 2):
            part = data[7 * k - 7 : 7 * k].ljust(7, b"\xff")
            added.append((now + 60 * k * MS, frame(0xEB00, source, bytes([k]) + part, ALL, 7)))
    return merged(scene.frames, added), f"{source}"


@fault_of_j1939(Cause.TROUBLE_CODE)
def code_comes_and_goes(scene: Scene) -> Found:
    """A device reports a code in every other DM1, as of a loose contact."""
    source = one_of_several(scene, 6000 * MS)
    with_code = Frame(0x18FECA00 | source, bytes.fromhex("04FF640003017FFF"), is_extended=True)
    without = Frame(0x18FECA00 | source, bytes.fromhex("00FF00000000FFFF"), is_extended=True)
    frames = scene.without(lambda e: is_from(e, source) and e.frame.can_id >> 8 & 0xFFFF == _DM1)
    times = range(int(scene.end * scene.share(0.1, 0.3)), scene.end, 1000 * MS)
    return merged(
        frames, [(t, with_code if k % 2 else without) for k, t in enumerate(times)]
    ), f"{source}"
