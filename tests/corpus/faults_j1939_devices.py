"""Faults of J1939 devices: silence, restarts, addresses and NAMEs."""

from corpus.faults import MS, Found, Scene, changed, fault_of_j1939, merged
from corpus.j1939_scene import (
    CLAIMED,
    NOBODY,
    Added,
    claims,
    drawn,
    frame,
    is_from,
    name_of,
    one_of_several,
    pdu_format,
    senders,
)
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.canopen_device.frame import Frame


@fault_of_j1939(Cause.J1939_SILENT)
def device_vanishes(scene: Scene) -> Found:
    """A device sends nothing from some time on."""
    message, since = drawn(scene), int(scene.end * scene.share(0.3, 0.7))
    if len(senders(scene)) < 2 or scene.end - since < 7 * message.period:
        return None
    if scene.end - since < 1500 * MS:
        return None
    gone = message.source
    return scene.without(lambda e: e.now > since and is_from(e, gone)), f"{gone}"


@fault_of_j1939(Cause.J1939_RESTART)
def device_restarts(scene: Scene) -> Found:
    """A device is silent for some seconds, claims its address anew and goes on."""
    gone = one_of_several(scene, 8000 * MS)
    since = int(scene.end * scene.share(0.25, 0.45))
    until = since + int(scene.share(1.2, 3.5) * 1000) * MS
    frames = scene.without(lambda e: since < e.now < until and is_from(e, gone))
    return merged(frames, [(until, frame(CLAIMED, gone, name_of(scene, gone)))]), f"{gone}"


@fault_of_j1939(Cause.J1939_RESTART)
def device_starts_again_and_again(scene: Scene) -> Found:
    """A device claims its address, sends for a moment, is silent, and begins anew."""
    gone = one_of_several(scene, 8000 * MS)
    since, name = int(scene.end * scene.share(0.2, 0.4)), name_of(scene, gone)
    up, down = int(scene.share(300, 900)) * MS, int(scene.share(700, 1600)) * MS
    begins = range(since + down, scene.end, up + down)
    frames = scene.without(
        lambda e: is_from(e, gone) and e.now > since and (e.now - since) % (up + down) < down
    )
    return merged(frames, [(now, frame(CLAIMED, gone, name)) for now in begins]), f"{gone}"


@fault_of_j1939(Cause.ADDRESS_CLASH)
def address_is_lost(scene: Scene) -> Found:
    """A device of a smaller NAME claims the address of another, which cannot claim any more."""
    lost = one_of_several(scene, 5000 * MS)
    at, name = int(scene.end * scene.share(0.3, 0.6)), name_of(scene, lost)
    number = int.from_bytes(name, "little")
    smaller = (number - (1 << 21) if number >> 21 & 0x7FF else number >> 1).to_bytes(8, "little")
    says = at + int(scene.share(2, 150)) * MS
    frames = scene.without(lambda e: is_from(e, lost) and e.now > at)
    added = [(at, frame(CLAIMED, lost, smaller)), (says, frame(CLAIMED, NOBODY, name))]
    return merged(frames, added), f"{lost}"


@fault_of_j1939(Cause.ADDRESS_CLASH)
def newcomer_gets_no_address(scene: Scene) -> Found:
    """A device of a greater NAME wants an address that is taken, is warded off, and has none."""
    found = claims(scene)
    if not found or scene.end < 4000 * MS:
        return None
    owner = scene.random.choice(sorted(found))
    claim = found[owner]
    name = claim.frame.data
    greater = bytes([*name[:3], 0xFF, name[4], name[5], name[6], 0x7F])
    if int.from_bytes(greater, "little") <= int.from_bytes(name, "little"):
        return None
    at = claim.now + int(scene.share(10, 800)) * MS
    says = at + 3 * MS + int(scene.share(1, 150)) * MS
    added = [
        (at, frame(CLAIMED, owner, greater)),
        (at + 2 * MS, claim.frame),
        (says, frame(CLAIMED, NOBODY, greater)),
    ]
    return merged(scene.frames, added), f"{owner}"


@fault_of_j1939(Cause.ADDRESS_CLASH)
def claims_never_settle(scene: Scene) -> Found:
    """Two devices claim one address in turns, and none yields."""
    owner = one_of_several(scene, 5000 * MS)
    name = name_of(scene, owner)
    other = bytes([name[0] ^ 0x55, *name[1:]])
    step, times = int(scene.share(4, 200) * MS), int(scene.share(8, 60))
    begin = int(scene.end * scene.share(0.2, 0.5))
    added: Added = []
    for number in range(times):
        now = begin + number * step
        if now < scene.end:
            added.append((now, frame(CLAIMED, owner, other if number % 2 == 0 else name)))
    return merged(scene.frames, added), f"{owner}"


@fault_of_j1939(Cause.NAME_CLASH)
def two_of_one_name(scene: Scene) -> Found:
    """Two devices at two addresses have the same NAME."""
    found = claims(scene)
    if len(found) < 2:
        return None
    one, other = scene.random.sample(sorted(found), 2)
    name, was = found[one].frame.data, found[other].frame.data
    frames = [
        changed(e, name) if pdu_format(e) == 0xEE and e.frame.data == was else e
        for e in scene.frames
    ]
    return frames, f"{one}|{other}"


@fault_of_j1939(Cause.ADDRESS_CLASH)
def second_sender_of_an_address(scene: Scene) -> Found:
    """A second device sends a message of another one's, from its address and with other values."""
    message = drawn(scene, 24)
    step = int(message.period * scene.share(0.85, 1.1))
    begin = int(scene.end * scene.share(0.3, 0.5)) + int(message.period * scene.random.random())
    own = [e.frame.data for e in scene.frames if e.frame.can_id == message.can_id]
    low = bytes(b if b >= 0xFA else (b + 77) % 250 for b in own[0])
    added = [
        (now, Frame(message.can_id, low, is_extended=True)) for now in range(begin, scene.end, step)
    ]
    return (merged(scene.frames, added), f"{message.source}") if len(added) >= 10 else None
