"""Faults of a node: its supply, its node-ID, its NMT state, its errors, its SDO server."""

import struct

from corpus.faults import MS, Found, Scene, changed, fault, is_from, merged, sender
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import LoggedFrame

_TWIN = 400_000
_TIMED_OUT = struct.pack("<I", 0x0504_0000)


def _name(node: int) -> str:
    return f"node {node}"


@fault(Cause.HEARTBEAT_LOST)
def supply_fails(scene: Scene) -> Found:
    """A node sends nothing from the middle on."""
    node, since = scene.choose(scene.beating()), scene.somewhen()
    if scene.end - since < 5 * scene.period(0x700 + node):
        return None
    left = scene.without(lambda each: each.now > since and sender(each) == node)
    if left[-1].now - since < 5 * scene.period(0x700 + node):
        return None  # nobody else is there to show that the log goes on
    return left, _name(node)


@fault(Cause.HEARTBEAT_LOST)
def bus_off(scene: Scene) -> Found:
    """A node is away for six of its heartbeats, and goes on where it was."""
    node = scene.choose(scene.beating())
    since = scene.somewhen(0.2, 0.3)
    until = since + 6 * scene.period(0x700 + node)
    if until > scene.end - scene.period(0x700 + node):
        return None
    left = scene.without(lambda each: since < each.now < until and sender(each) == node)
    return left, _name(node)


@fault(Cause.HEARTBEAT_LOST)
def heartbeat_alone_stops(scene: Scene) -> Found:
    """The heartbeat of a node stops; all else goes on."""
    node, since = scene.choose(scene.beating()), scene.somewhen()
    if scene.end - since < 5 * scene.period(0x700 + node):
        return None
    left = scene.without(lambda each: each.now > since and is_from(each, 0x700 + node))
    return left, _name(node)


@fault(Cause.NO_BOOT_UP)
def node_absent(scene: Scene) -> Found:
    """A node that is asked and commanded is not there."""
    node = scene.choose(scene.slaves())
    return scene.without(lambda each: sender(each) == node), _name(node)


@fault(Cause.RESTART)
def supply_breaks(scene: Scene) -> Found:
    """A node restarts in the middle, and waits in PRE-OPERATIONAL ever after."""
    node = scene.choose(scene.slaves())
    since, period = scene.somewhen(), scene.period(0x700 + node)
    left = scene.without(lambda each: each.now > since and sender(each) == node)
    boot = [(since + 30 * MS, Frame(0x700 + node, b"\0"))]
    return merged(left, boot), _name(node) if period else ""


@fault(Cause.RESTART)
def watchdog_bites(scene: Scene) -> Found:
    """A node restarts every 400 ms."""
    node = scene.choose(scene.slaves())
    since = scene.somewhen(0.3, 0.4)
    left = scene.without(lambda each: each.now > since and sender(each) == node)
    boots = [
        (now, Frame(0x700 + node, b"\0")) for now in range(since + 50 * MS, scene.end, 400 * MS)
    ]
    return (merged(left, boots), _name(node)) if boots else None


@fault(Cause.NODE_ID_CLASH)
def twin_from_start(scene: Scene) -> Found:
    """A second device has the node-ID of one: all that it sends comes twice, 0.4 ms apart."""
    node = scene.choose(scene.slaves())
    twins = [(each.now + _TWIN, each.frame) for each in scene.frames if sender(each) == node]
    return merged(scene.frames, twins), _name(node)


@fault(Cause.NODE_ID_CLASH)
def twin_is_plugged_in(scene: Scene) -> Found:
    """A device with the node-ID of one boots in the middle, and beats in PRE-OPERATIONAL."""
    node = scene.choose(scene.slaves())
    since, period = scene.somewhen(), scene.period(0x700 + node)
    beats = range(since + period // 3, scene.end, period)
    twin = [
        (since, Frame(0x700 + node, b"\0")),
        *((now, Frame(0x700 + node, b"\x7f")) for now in beats),
    ]
    return (merged(scene.frames, twin), _name(node)) if len(beats) >= 5 else None


@fault(Cause.NOT_STARTED)
def never_started(scene: Scene) -> Found:
    """The master starts all but one: that stays in PRE-OPERATIONAL, without PDOs."""
    node = scene.choose(scene.slaves())
    starts = [
        each for each in scene.frames if each.frame.can_id == 0 and each.frame.data[:1] == b"\1"
    ]
    others = [other for other in scene.slaves() if other != node]
    if (
        not starts
        or not others
        or not any(
            is_from(each, 0x700 + node) and each.frame.data == b"\0" for each in scene.frames
        )
    ):
        return None
    began = [
        each.now
        for each in scene.frames
        if is_from(each, 0x700 + node) and each.frame.data == b"\5"
    ]
    if len(starts) > 2 * len(others) + 2 or scene.end - starts[0].now < 1300 * MS:
        return None
    if any(now < starts[0].now for now in began):
        return None  # it starts by itself
    frames = []
    for each in _stays_out(scene, node, starts[0].now):
        if each.frame.can_id == 0 and each.frame.data == bytes((1, node)):
            continue
        if each.frame.can_id == 0 and each.frame.data == b"\1\0":
            frames += [changed(each, bytes((1, other))) for other in others]
            continue
        frames.append(each)
    return frames, _name(node)


def _stays_out(scene: Scene, node: int, since: int) -> list[LoggedFrame]:
    """Return the frames with a node in PRE-OPERATIONAL from a time on."""
    frames = []
    for each in scene.frames:
        if each.now >= since and sender(each) == node:
            if 0x180 <= each.frame.can_id < 0x500:
                continue
            if each.frame.can_id == 0x700 + node and each.frame.data == b"\5":
                frames.append(changed(each, b"\x7f"))
                continue
        frames.append(each)
    return frames


@fault(Cause.START_REFUSED)
def start_does_not_arrive(scene: Scene) -> Found:
    """A node is started, and says PRE-OPERATIONAL ever after."""
    node = scene.choose(scene.slaves())
    starts = [
        each.now for each in scene.frames if each.frame.can_id == 0 and each.frame.data[:1] == b"\1"
    ]
    if not starts or scene.end - starts[-1] < 1300 * MS:
        return None
    return _stays_out(scene, node, starts[0]), _name(node)


@fault(Cause.STATE_LEFT)
def leaves_operational(scene: Scene) -> Found:
    """A node goes to PRE-OPERATIONAL in the middle, and nobody has commanded it."""
    node, since = scene.choose(scene.slaves()), scene.somewhen()
    commands = [each for each in scene.frames if each.frame.can_id == 0 and each.now > since]
    if commands or len([now for now in scene.beats(node) if now > since]) < 2:
        return None
    return _stays_out(scene, node, since), _name(node)


@fault(Cause.EMCY)
def leaves_operational_by_error(scene: Scene) -> Found:
    """A node says EMCY 0x5000 and goes to PRE-OPERATIONAL by itself."""
    node, since = scene.choose(scene.slaves()), scene.somewhen()
    commands = [each for each in scene.frames if each.frame.can_id == 0 and each.now > since]
    if commands:
        return None
    emcy = (since, Frame(0x080 + node, bytes.fromhex("0050010000000000")))
    return merged(_stays_out(scene, node, since), [emcy]), _name(node)


@fault(Cause.EMCY)
def emergency_storm(scene: Scene) -> Found:
    """A node says 0x3100, mains voltage, and that it is gone, 100 times in turn."""
    node, since = scene.choose(scene.slaves()), scene.somewhen()
    words = (bytes.fromhex("0031050000000000"), bytes(8))
    storm = [(since + k * 2 * MS, Frame(0x080 + node, words[k % 2])) for k in range(200)]
    return merged(scene.frames, [each for each in storm if each[0] < scene.end]), _name(node)


@fault(Cause.EMCY)
def emergency(scene: Scene) -> Found:
    """A node says once that its temperature is too high."""
    node, since = scene.choose(scene.slaves()), scene.somewhen()
    return merged(
        scene.frames, [(since, Frame(0x080 + node, bytes.fromhex("0042090000000000")))]
    ), _name(node)


@fault(Cause.SDO_LATE)
def slow_server(scene: Scene) -> Found:
    """A node answers a request 120 ms late, 20 ms after its client has given up."""
    node = scene.choose(scene.slaves())
    cyclic = {0x080, *range(0x181, 0x500)}
    first = min((each.now for each in scene.frames if each.frame.can_id in cyclic), default=0)
    early = [
        each
        for each in (scene.downloads(node))
        if not first or scene.frames[each.answer].now < first
    ]
    if not early:
        return None
    answers = {each.answer: each.place for each in early[-1:]}
    frames, shift = [], 0
    for place, each in enumerate(scene.frames):
        if place in answers:
            asked = scene.frames[answers[place]]
            give_up = Frame(0x600 + node, b"\x80" + asked.frame.data[1:4] + _TIMED_OUT)
            given_up = each.now + shift + 100 * MS - (each.now - asked.now)
            frames.append(LoggedFrame(give_up, given_up, None))
            shift += 120 * MS - (each.now - asked.now)
        frames.append(each._replace(now=each.now + shift))
    return sorted(frames, key=lambda each: each.now), _name(node)


@fault(Cause.SDO_ABORT)
def access_refused(scene: Scene) -> Found:
    """A node refuses a download: the value is out of range (0609 0030h)."""
    node = scene.choose(scene.slaves())
    downloads = scene.downloads(node)
    wanted = [
        d for d in downloads if d.index not in {0x1017, 0x1800, 0x1A00, 0x1005, 0x1006}
    ] or downloads
    one = scene.choose(wanted)
    refusal = b"\x80" + struct.pack("<HB", one.index, one.subindex) + struct.pack("<I", 0x0609_0030)
    frames = list(scene.frames)
    frames[one.answer] = changed(frames[one.answer], refusal)
    return frames, _name(node)


@fault(Cause.SDO_NO_ANSWER)
def answer_lost(scene: Scene) -> Found:
    """The last SDO request to a node gets no answer; the node is well."""
    node = scene.choose(scene.slaves())
    downloads = scene.downloads(node)
    later = [d for d in downloads if scene.end - scene.frames[d.place].now > 1200 * MS]
    if not later or later[-1] != downloads[-1]:
        return None
    frames = list(scene.frames)
    del frames[later[-1].answer]
    return frames, _name(node)
