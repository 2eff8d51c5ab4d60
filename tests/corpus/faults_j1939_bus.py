"""Faults of a J1939 bus: load, bit rates, silence, two logs in one; and requests to devices."""

from corpus.faults import MS, Found, Scene, fault_of_j1939, merged
from corpus.j1939_scene import (
    REQUEST,
    Added,
    cyclic,
    drawn,
    frame,
    group_of,
    is_from,
    one_of_several,
)
from corpus.logs import is_kept_apart, manifest, sound_log
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.canopen_device.frame import Frame

_ERROR_FLAG = 0x20000000
_TOOL = 249


@fault_of_j1939(Cause.BUS_LOAD)
def device_babbles(scene: Scene) -> Found:
    """A device floods the bus with one message for a while."""
    message = drawn(scene)
    step = int(1e9 * 128 / scene.log.bitrate / scene.share(0.85, 0.95))
    begin = int(scene.end * scene.share(0.3, 0.6))
    lasts = int(scene.share(400, 1500)) * MS
    data = next(e.frame for e in scene.frames if e.frame.can_id == message.can_id)
    return merged(scene.frames, [(t, data) for t in range(begin, begin + lasts, step)]), ""


@fault_of_j1939(Cause.ERROR_FRAMES)
def device_of_another_bit_rate(scene: Scene) -> Found:
    """A device of another bit rate destroys what is on the bus, in bursts."""
    begin = int(scene.end * scene.share(0.2, 0.5))
    every, lasts = int(scene.share(300, 1100)) * MS, int(scene.share(15, 120)) * MS
    bursts = [*range(begin, scene.end - lasts, every)][: int(scene.share(3, 12))]
    frames = scene.without(lambda e: any(b <= e.now < b + lasts for b in bursts))
    error = Frame(_ERROR_FLAG | 0x88, bytes.fromhex("0000040000000000"))
    return merged(frames, [(t, error) for b in bursts for t in range(b, b + lasts, 2 * MS)]), ""


@fault_of_j1939(Cause.BUS_SILENT)
def bus_goes_silent(scene: Scene) -> Found:
    """Nothing at all is on the bus for a time."""
    fast = [e for e in cyclic(scene) if e.period <= 300 * MS]
    if len({e.source for e in fast}) < 2 or scene.end < 6000 * MS:
        return None
    since = int(scene.end * scene.share(0.35, 0.55))
    until = since + int(scene.share(900, 2600)) * MS
    return scene.without(lambda e: since < e.now < until), ""


@fault_of_j1939(Cause.TWO_RECORDINGS)
def recorded_twice(scene: Scene) -> Found:
    """Each frame comes twice, as of two adapters on one bus."""
    if not cyclic(scene):
        return None
    later = int(scene.share(3, 40) * MS)
    return merged(scene.frames, [(e.now + later, e.frame) for e in scene.frames]), ""


@fault_of_j1939(Cause.TWO_BUSES)
def log_of_two_buses(scene: Scene) -> Found:
    """The frames of another bus with some of the same addresses are between, as if it were one."""
    mine = {c.can_id for c in cyclic(scene)}
    apart = is_kept_apart(scene.log.name)
    names = [
        name
        for name, entry in sorted(manifest().items())
        if entry.get("series") and is_kept_apart(name) is apart and name != scene.log.name
    ]
    scene.random.shuffle(names)
    for name in names:
        other = Scene(sound_log(name), scene.random)
        shared = mine & {c.can_id for c in cyclic(other)}
        if len({can_id & 0xFF for can_id in shared}) >= 2:
            return merged(
                scene.frames, [(e.now, e.frame) for e in other.frames if e.now <= scene.end]
            ), ""
    return None


@fault_of_j1939(Cause.J1939_REQUEST)
def request_is_not_answered(scene: Scene) -> Found:
    """A device is asked for a group, three times, and says nothing."""
    asked = _asked(scene)
    return None if asked is None else _answered(scene, asked, [])


@fault_of_j1939(Cause.J1939_REQUEST)
def request_is_denied(scene: Scene) -> Found:
    """A device is asked for a group and says no, or that access is denied."""
    asked = _asked(scene)
    if asked is None:
        return None
    source, group, times = asked
    word = group.to_bytes(3, "little")
    kind = 1 + scene.random.randrange(2)
    said = frame(0xE800, source, bytes([kind, 0xFF, 0xFF, 0xFF, _TOOL]) + word)
    return _answered(scene, asked, [(at + 15 * MS, said) for at in times])


@fault_of_j1939(Cause.J1939_REQUEST)
def request_is_answered_late(scene: Scene) -> Found:
    """A device answers a request long after the time that the standard gives it."""
    asked = _asked(scene, 0xFEE5, 1)
    if asked is None:
        return None
    source, group, (at,) = asked
    said = frame(group, source, b"\x11\x22\3\0\xff\xff\xff\xff")
    return _answered(scene, asked, [(at + int(scene.share(1500, 3500)) * MS, said)])


Asked = tuple[int, int, list[int]]
"""A device, the group that it is asked for, and when [ns]."""


def _asked(scene: Scene, group: int | None = None, times: int = 3) -> Asked | None:
    source = one_of_several(scene, 6000 * MS)
    asked = group or scene.random.choice((0xFEE5, 0xFEDA, 0xFECB, 0xFEEB, 0xFEEC, 0xFEFC))
    if any(is_from(e, source) and group_of(e.frame.can_id) == asked for e in scene.frames):
        return None
    at = int(scene.end * scene.share(0.2, 0.4))
    return source, asked, [at + k * 400 * MS for k in range(times)]


def _answered(scene: Scene, asked: Asked, answers: Added) -> Found:
    source, group, times = asked
    question = frame(REQUEST, _TOOL, group.to_bytes(3, "little"), source)
    added = [*((at, question) for at in times), *answers]
    return merged(scene.frames, sorted(added, key=lambda e: e[0])), f"{source}|{_TOOL}"
