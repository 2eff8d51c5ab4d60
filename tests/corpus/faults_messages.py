"""Faults of messages and of their configuration: PDOs, SYNC, timers, the bus itself."""

import struct

from corpus.faults import MS, Found, Frames, Scene, changed, fault, is_from, merged, sender
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.canopen_device.frame import Frame
from hil_bench.frame import ERROR_FLAG
from hil_bench.outside.recording.channels import LoggedFrame

_CYCLIC = range(1, 241)


def _pdo(
    scene: Scene, *, cyclic: bool | None = None, timed: bool = False
) -> tuple[int, int] | None:
    """Draw a node and its TPDO1.

    Args:
        scene: the log.
        cyclic: whether it follows SYNC; None for either.
        timed: whether somebody has set its event timer.
    """
    found = []
    for node in scene.slaves():
        can_id = 0x180 + node
        if can_id not in scene.tpdos(node):
            continue
        kind, timer = scene.download(node, 0x1800, 2), scene.download(node, 0x1800, 5)
        is_cyclic = kind is not None and kind.value in _CYCLIC
        if cyclic is not None and is_cyclic is not cyclic:
            continue
        if timed and (timer is None or not timer.value):
            continue
        found.append((node, can_id))
    return scene.random.choice(found) if found else None


def _due(scene: Scene) -> tuple[int, int] | None:
    return _pdo(scene, cyclic=True) or _pdo(scene, timed=True)


def _is_between(scene: Scene, can_id: int, now: int) -> bool:
    """Return True if a PDO comes eight times before a time, and eight times after it."""
    times = scene.times(can_id)
    return sum(each < now for each in times) >= 8 <= sum(each > now for each in times)


def _rewritten(frames: Frames, place: int, value: int) -> None:
    data = frames[place].frame.data
    frames[place] = changed(frames[place], data[:4] + struct.pack("<I", value))


@fault(Cause.PDO_MISSING)
def pdo_stops(scene: Scene) -> Found:
    """TPDO1 of a node stops in the middle, and its heartbeat goes on."""
    found, since = _due(scene), scene.somewhen()
    if found is None or not _is_between(scene, found[1], since):
        return None
    return scene.without(
        lambda each: each.now > since and is_from(each, found[1])
    ), f"node {found[0]}"


@fault(Cause.PDO_MISSING)
def pdo_gap(scene: Scene) -> Found:
    """TPDO1 of a node stays out for six periods."""
    found, since = _due(scene), scene.somewhen()
    if found is None or not _is_between(scene, found[1], since):
        return None
    until = since + 6 * scene.period(found[1])
    left = scene.without(lambda each: since < each.now < until and is_from(each, found[1]))
    return (left, f"node {found[0]}") if until < scene.end - 100 * MS else None


@fault(Cause.PDO_MISSING)
def pdo_without_timer_falls_silent(scene: Scene) -> Found:
    """A TPDO with event timer 0 came again and again, and stops."""
    found, since = _pdo(scene, cyclic=False, timed=True), scene.somewhen()
    came = [now for now in scene.times(found[1]) if now < since] if found else []
    if found is None or scene.end - since < 1200 * MS or len(came) < 40:
        return None
    timer = scene.download(found[0], 0x1800, 5)
    frames = list(scene.frames)
    if timer is None:
        return None
    _rewritten(frames, timer.place, 0)
    return [
        each for each in frames if not (each.now > since and is_from(each, found[1]))
    ], f"node {found[0]}"


@fault(Cause.PDO_LENGTH)
def pdo_too_short(scene: Scene) -> Found:
    """TPDO1 of a node has a byte less than its mapping, from the middle on."""
    found, since = _pdo(scene), scene.somewhen()
    if found is None or not (scene.download(found[0], 0x1A00, 1) or found[0] in scene.log.eds):
        return None
    return [
        changed(each, each.frame.data[:-1])
        if each.now > since and is_from(each, found[1])
        else each
        for each in scene.frames
    ], f"node {found[0]}"


@fault(Cause.PDO_LENGTH)
def pdo_too_long(scene: Scene) -> Found:
    """TPDO1 of a node has a byte more than its mapping."""
    found = _pdo(scene)
    if found is not None and any(
        len(e.frame.data) == 8 for e in scene.frames if is_from(e, found[1])
    ):
        return None
    if found is None or not (scene.download(found[0], 0x1A00, 1) or found[0] in scene.log.eds):
        return None
    return [
        changed(each, (each.frame.data + b"\x55")[:8]) if is_from(each, found[1]) else each
        for each in scene.frames
    ], f"node {found[0]}"


@fault(Cause.IDENTIFIER_CLASH)
def copied_configuration(scene: Scene) -> Found:
    """TPDO1 of two nodes has one identifier: the master's file was copied."""
    nodes = [
        n for n in scene.slaves() if scene.download(n, 0x1800, 1) and 0x180 + n in scene.tpdos(n)
    ]
    if len(nodes) < 2:
        return None
    first, second = nodes[:2]
    frames = list(scene.frames)
    for each in scene.downloads(second):
        if (each.index, each.subindex) == (0x1800, 1):
            _rewritten(frames, each.place, each.value & ~0x7FF | 0x180 + first)
    return [
        changed(each, can_id=0x180 + first) if is_from(each, 0x180 + second) else each
        for each in frames
    ], f"node {second}"


@fault(Cause.PDO_TIMERS)
def inhibit_above_event(scene: Scene) -> Found:
    """The inhibit time of a TPDO is four times its event timer; it comes as the former allows."""
    found = _pdo(scene, cyclic=False, timed=True)
    if found is None:
        return None
    node, can_id = found
    timer = scene.download(node, 0x1800, 5)
    if timer is None:
        return None
    if scene.download(node, 0x1800, 3) is not None:
        return None
    written = struct.pack("<BHBI", 0x2B, 0x1800, 3, timer.value * 40)
    at = scene.frames[timer.answer].now
    added = [
        (at + 100_000, Frame(0x600 + node, written)),
        (at + 200_000, Frame(0x580 + node, b"\x60\0\x18\3" + bytes(4))),
    ]
    left, last = [], -(1 << 60)
    for each in scene.frames:
        if is_from(each, can_id):
            if each.now - last < (timer.value * 4 - 1) * MS:
                continue
            last = each.now
        left.append(each)
    return merged(left, added), f"node {node}"


@fault(Cause.ABSENT_PRODUCER)
def waits_for_sync_of_nobody(scene: Scene) -> Found:
    """TPDO1 was given type 1, and nobody sends SYNC."""
    found = _pdo(scene, cyclic=False)
    if found is None or scene.times(0x080) or scene.end < 1500 * MS:
        return None
    kind, timer = scene.download(found[0], 0x1800, 2), scene.download(found[0], 0x1800, 5)
    place = kind or timer
    if place is None:
        return None
    frames = [each for each in scene.frames if not is_from(each, found[1])]
    at = frames.index(scene.frames[place.answer])
    now = frames[at].now
    return merged(
        frames,
        [
            (now + 100_000, Frame(0x600 + found[0], bytes.fromhex("2F00180201000000"))),
            (now + 200_000, Frame(0x580 + found[0], bytes.fromhex("6000180200000000"))),
        ],
    ), f"node {found[0]}"


@fault(Cause.ABSENT_PRODUCER)
def watches_nobody(scene: Scene) -> Found:
    """A node was given the heartbeat of node 99 to watch (0x1016), which is not there."""
    node = scene.random.choice(scene.slaves()) if scene.slaves() else None
    downloads = scene.downloads(node) if node else []
    if node is None or not downloads or any(sender(each) == 99 for each in scene.frames):
        return None
    now = scene.frames[downloads[-1].answer].now
    return merged(
        scene.frames,
        [
            (now + 100_000, Frame(0x600 + node, bytes.fromhex("23161001F4016300"))),
            (now + 200_000, Frame(0x580 + node, bytes.fromhex("6016100100000000"))),
        ],
    ), f"node {node}"


def _syncs(scene: Scene) -> list[int]:
    times = scene.times(0x080)
    return times if len(times) >= 20 else []


def _follows_sync(each: LoggedFrame) -> bool:
    return 0x180 <= each.frame.can_id < 0x500 and not each.frame.is_extended


@fault(Cause.SYNC_MISSING)
def sync_stops(scene: Scene) -> Found:
    """SYNC stops, and so do the PDOs; the heartbeats go on."""
    since = scene.somewhen(0.3, 0.4)
    before = [now for now in _syncs(scene) if now < since]
    if len(before) < 10 or scene.end - since < 1300 * MS:
        return None
    return scene.without(
        lambda each: each.now > since and (is_from(each, 0x080) or _follows_sync(each))
    ), ""


@fault(Cause.SYNC_MISSING)
def sync_pauses(scene: Scene) -> Found:
    """SYNC stays out for twelve periods, and so do the PDOs."""
    since, period = scene.somewhen(), scene.period(0x080)
    if not _syncs(scene) or since + 14 * period > scene.end:
        return None
    until = since + 12 * period
    return scene.without(
        lambda each: since < each.now < until and (is_from(each, 0x080) or _follows_sync(each))
    ), ""


@fault(Cause.SYNC_JITTER)
def sync_jitters(scene: Scene) -> Found:
    """SYNC comes up to 45 % of its period late, and all that follows it with it."""
    period = scene.period(0x080)
    if not _syncs(scene):
        return None
    late, frames = 0, []
    for each in scene.frames:
        if is_from(each, 0x080):
            late = round(period * 0.45 * scene.random.random())
        shift = late if is_from(each, 0x080) or _follows_sync(each) else 0
        frames.append(each._replace(now=each.now + shift))
    return sorted(frames, key=lambda each: each.now), ""


@fault(Cause.SYNC_PERIOD)
def sync_of_another_period(scene: Scene) -> Found:
    """0x1006 of a node says four times the period that SYNC has."""
    period = scene.period(0x080)
    if not _syncs(scene):
        return None
    frames = list(scene.frames)
    for node in scene.slaves():
        if written := scene.download(node, 0x1006, 0):
            _rewritten(frames, written.place, written.value * 4)
            return frames, ""
    for node in scene.slaves():
        if downloads := scene.downloads(node):
            now = scene.frames[downloads[-1].answer].now
            value = struct.pack("<BHBI", 0x23, 0x1006, 0, period // 1000 * 4)
            return merged(
                frames,
                [
                    (now + 100_000, Frame(0x600 + node, value)),
                    (now + 200_000, Frame(0x580 + node, bytes.fromhex("6006100000000000"))),
                ],
            ), ""
    return None


@fault(Cause.BUS_SILENT)
def bus_is_cut(scene: Scene) -> Found:
    """Nothing is on the bus for 0.7 s: a cable, the termination, or the adapter that records."""
    since = scene.somewhen(0.3, 0.4)
    until = since + 700 * MS
    quick = [n for n in scene.beating() if 3 * scene.period(0x700 + n) < 700 * MS]
    if len(quick) < 2:
        return None
    left = scene.without(lambda each: since < each.now < until)
    if until > scene.end - 300 * MS or len(scene.frames) - len(left) < 30:
        return None
    return left, ""


@fault(Cause.ERROR_FRAMES)
def disturbed_bus(scene: Scene) -> Found:
    """Twenty error frames of the adapter: protocol violations."""
    since = scene.somewhen()
    error = Frame(ERROR_FLAG | 0x8, bytes.fromhex("0000040000000000"))
    return merged(scene.frames, [(since + k * 3 * MS, error) for k in range(20)]), ""


@fault(Cause.BUS_LOAD)
def flooded_bus(scene: Scene) -> Found:
    """A device floods the bus with an identifier of high priority for 0.4 s."""
    since = scene.somewhen(0.4, 0.5)
    step = 135 * 1_000_000_000 // scene.log.bitrate
    if scene.end - since < 600 * MS:
        return None
    flood = [(now, Frame(0x07F, bytes(8))) for now in range(since, since + 400 * MS, step)]
    return merged(scene.frames, flood), ""


@fault(Cause.MAPPING)
def mapped_in_another_order(scene: Scene) -> Found:
    """RPDO1 of a valve or drive is mapped the other way round; its master sends as before."""
    with_word = [n for n, name in scene.log.eds.items() if name.startswith(("valve", "drive"))]
    nodes = [n for n in with_word if len(scene.times(0x200 + n)) >= 30 and scene.downloads(n)]
    if not nodes:
        return None
    node = nodes[0]
    objects = next(each for each in scene.log.known() if each.node_id == node)
    mapped = [objects.number(0x1600, place) for place in range(1, objects.number(0x1600) + 1)]
    if len(mapped) < 2 or mapped[0] >> 16 != 0x6040:
        return None
    enable = objects.number(0x1400, 1)
    steps = [
        (0x23, 0x1400, 1, enable | 1 << 31),
        (0x2F, 0x1600, 0, 0),
        *((0x23, 0x1600, place, value) for place, value in enumerate(reversed(mapped), 1)),
        (0x2F, 0x1600, 0, len(mapped)),
        (0x23, 0x1400, 1, enable),
    ]
    first = scene.times(0x200 + node)[0]
    before = [scene.frames[each.answer].now for each in scene.downloads(node)]
    before = [each for each in before if each < first]
    if not before:
        return None
    now, added = before[-1], []
    for command, index, subindex, value in steps:
        now += 20_000
        added.append(
            (now, Frame(0x600 + node, struct.pack("<BHBI", command, index, subindex, value)))
        )
        added.append(
            (now + 9000, Frame(0x580 + node, struct.pack("<BHBI", 0x60, index, subindex, 0)))
        )
    return merged(scene.frames, added), f"node {node}"
