"""Faults of J1939 messages: period, length, values, priority, trouble codes."""

from corpus.faults import MS, Found, Scene, changed, fault_of_j1939, merged
from corpus.j1939_scene import cyclic, drawn, frame, group_of, is_from, one_of_several
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.outside.recording.channels import LoggedFrame

_DM1 = 0xFECA
_SPNS = {
    0xF004: (3, 2),
    0xF003: (1, 1),
    0xFEF1: (1, 2),
    0xFEEE: (0, 1),
    0xFEEF: (3, 1),
    0xFEF7: (4, 2),
    0xFEF5: (3, 2),
    0xFEFC: (1, 1),
}
"""Place and bytes of a signal of parameter groups that J1939-71 defines."""


@fault_of_j1939(Cause.J1939_MISSING)
def message_stops(scene: Scene) -> Found:
    """One message of a device stops for good; its others go on."""
    found = cyclic(scene)
    found = [e for e in found if sum(o.source == e.source for o in found) > 1]
    found = [e for e in found if e.period * 12 < scene.end]
    gone, since = scene.choose(found), int(scene.end * scene.share(0.4, 0.6))
    return scene.without(
        lambda e: e.now > since and e.frame.can_id == gone.can_id
    ), f"{gone.source}"


@fault_of_j1939(Cause.J1939_PERIOD)
def message_comes_more_seldom(scene: Scene) -> Found:
    """A message comes with twice or three times its period from some time on."""
    message = drawn(scene, 40)
    if group_of(message.can_id) == 0xF004:
        return None
    since, each_of = int(scene.end * scene.share(0.35, 0.5)), 2 + scene.random.randrange(2)
    late = [t for t in message.times if t > since]
    kept = frozenset(late[::each_of])
    return scene.without(
        lambda e: e.frame.can_id == message.can_id and e.now > since and e.now not in kept
    ), f"{message.source}"


@fault_of_j1939(Cause.J1939_PERIOD)
def message_jitters(scene: Scene) -> Found:
    """A regular message comes up to most of a period early or late from some time on."""
    message = drawn(scene, 40)
    since, width = int(scene.end * scene.share(0.35, 0.5)), scene.share(0.55, 0.95)
    frames = [
        e._replace(now=e.now + int(message.period * width * (scene.random.random() - 0.5) * 2))
        if e.frame.can_id == message.can_id and since < e.now < scene.end - message.period
        else e
        for e in scene.frames
    ]
    return sorted(frames, key=lambda e: e.now), f"{message.source}"


@fault_of_j1939(Cause.J1939_LENGTH)
def message_gets_shorter(scene: Scene) -> Found:
    """A message of eight bytes has fewer from some time on."""
    message = drawn(scene, 16)
    since, length = int(scene.end * scene.share(0.3, 0.6)), int(scene.share(1, 7.99))
    frames = [
        changed(e, e.frame.data[:length])
        if e.frame.can_id == message.can_id and e.now > since
        else e
        for e in scene.frames
    ]
    return frames, f"{message.source}"


def _indicated(scene: Scene, high: int) -> Found:
    found = [e for e in cyclic(scene) if group_of(e.can_id) in _SPNS]
    message, since = scene.choose(found), int(scene.end * scene.share(0.3, 0.6))
    at, length = _SPNS[group_of(message.can_id)]
    was = next(e.frame.data for e in scene.frames if e.frame.can_id == message.can_id)
    if was[at + length - 1] >= 0xFB:
        return None
    shown = bytes([0xFF] * (length - 1) + [high])
    frames = [
        changed(e, e.frame.data[:at] + shown + e.frame.data[at + length :])
        if e.frame.can_id == message.can_id and e.now > since
        else e
        for e in scene.frames
    ]
    return frames, f"{message.source}"


@fault_of_j1939(Cause.J1939_INDICATOR)
def signal_shows_an_error(scene: Scene) -> Found:
    """A signal shows the error indicator from some time on."""
    return _indicated(scene, 0xFE)


@fault_of_j1939(Cause.J1939_INDICATOR)
def signal_is_not_available(scene: Scene) -> Found:
    """A signal that had values shows "not available" from some time on."""
    return _indicated(scene, 0xFF)


@fault_of_j1939(Cause.J1939_PRIORITY)
def priority_changes(scene: Scene) -> Found:
    """A message comes with another priority from some time on."""
    message = drawn(scene, 16)
    since, was = int(scene.end * scene.share(0.3, 0.6)), message.can_id >> 26
    other = scene.random.choice([each for each in range(8) if each != was])
    can_id = message.can_id & 0x3FFFFFF | other << 26
    frames = [
        changed(e, can_id=can_id) if e.frame.can_id == message.can_id and e.now > since else e
        for e in scene.frames
    ]
    return frames, f"{message.source}"


@fault_of_j1939(Cause.TROUBLE_CODE)
def lamp_without_a_code(scene: Scene) -> Found:
    """A device has a lamp on in its DM1 each second, and no code."""
    return _diagnosed(scene, lambda lamp: bytes([lamp, 0xFF, 0, 0, 0, 0, 0xFF, 0xFF]))


@fault_of_j1939(Cause.TROUBLE_CODE)
def code_appears(scene: Scene) -> Found:
    """A device reports a trouble code by DM1 each second."""
    spn, fmi = int(scene.share(20, 520191)), int(scene.share(0, 20.99))
    code = bytes([spn & 0xFF, spn >> 8 & 0xFF, spn >> 16 << 5 | fmi, 1])
    return _diagnosed(scene, lambda lamp: bytes([lamp, 0xFF, *code, 0xFF, 0xFF]))


def _diagnosed(scene: Scene, dm1) -> Found:
    source = one_of_several(scene, 4000 * MS)
    said = frame(_DM1, source, dm1(scene.random.choice((0x40, 0x10, 0x04, 0x01))))
    begin = int(scene.end * scene.share(0.1, 0.5))
    frames = scene.without(lambda e: e.now > begin and is_dm1(e, source))
    return merged(frames, [(t, said) for t in range(begin, scene.end, 1000 * MS)]), f"{source}"


def is_dm1(each: LoggedFrame, source: int) -> bool:
    """Return True for a DM1 of an address."""
    return is_from(each, source) and group_of(each.frame.can_id) == _DM1


@fault_of_j1939(Cause.J1939_MISSING)
def dm1_stops(scene: Scene) -> Found:
    """A device reports a trouble code each second, and stops while it is active."""
    source = one_of_several(scene, 9000 * MS)
    said = frame(_DM1, source, bytes.fromhex("04FF6E000001FFFF"))
    end = int(scene.end * scene.share(0.45, 0.55))
    frames = scene.without(lambda e: is_dm1(e, source))
    return merged(frames, [(t, said) for t in range(300 * MS, end, 1000 * MS)]), f"{source}"
