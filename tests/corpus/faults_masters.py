"""Faults of masters, and of services beside PDO and heartbeat: guarding, SYNC, RPDO, requests."""

from corpus.faults import MS, Found, Scene, changed, fault, is_from, merged, sender
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import LoggedFrame


def _name(node: int) -> str:
    return f"node {node}"


@fault(Cause.HEARTBEAT_LOST)
def guard_unanswered(scene: Scene) -> Found:
    """A node answers node guarding no more, nor anything else; the master goes on asking."""
    asked = sorted(
        {
            each.frame.can_id - 0x700
            for each in scene.frames
            if 0x700 < each.frame.can_id < 0x780 and each.frame.is_remote
        }
    )
    node, since = scene.choose(asked), scene.end * 55 // 100
    return scene.without(lambda each: each.now > since and sender(each) == node), _name(node)


@fault(Cause.RPDO_TIMEOUT)
def set_points_stop(scene: Scene) -> Found:
    """The master's set-points to a node stop; its RPDO has a time-out."""
    nodes = [
        node
        for node in scene.slaves()
        if (timer := scene.download(node, 0x1400, 5)) is not None
        and timer.value
        and len(scene.times(0x200 + node)) >= 30
    ]
    node, since = scene.choose(nodes), scene.somewhen()
    if scene.end - since < 1000 * MS:
        return None
    return scene.without(lambda each: each.now > since and is_from(each, 0x200 + node)), _name(node)


@fault(Cause.SYNC_TWICE)
def two_sync_producers(scene: Scene) -> Found:
    """A second device produces SYNC, with a period that is 3 % longer."""
    times, period = scene.times(0x080), scene.period(0x080)
    if len(times) < 20 or any(each.frame.data for each in scene.frames if is_from(each, 0x080)):
        return None
    since = times[len(times) // 4] + period // 3
    second = range(since, scene.end, period * 103 // 100)
    return merged(scene.frames, [(now, Frame(0x080, b"")) for now in second]), ""


@fault(Cause.SYNC_COUNTER)
def sync_counter_of_the_producer_alone(scene: Scene) -> Found:
    """SYNC has a counter of 1 to 10, and a node says EMCY 0x8240 to each: its 0x1019 is 0."""
    nodes = [node for node in scene.slaves() if scene.tpdos(node)]
    if len(scene.times(0x080)) < 20 or not nodes:
        return None
    node, frames, count = scene.random.choice(nodes), [], 0
    for each in scene.frames:
        if not is_from(each, 0x080):
            frames.append(each)
            continue
        if each.frame.data:
            return None
        frames.append(changed(each, bytes([count % 10 + 1])))
        emcy = Frame(0x080 + node, bytes.fromhex("4082110100000000"))
        frames.append(each._replace(frame=emcy, now=each.now + MS // 2))
        count += 1
    return sorted(frames, key=lambda each: each.now), ""


@fault(Cause.HEARTBEAT_LOST)
def heartbeat_slower_than_set(scene: Scene) -> Found:
    """Three of four heartbeats stay out, from the first on: the device does not keep 0x1017."""
    nodes = [n for n in scene.slaves() if scene.download(n, 0x1017, 0) is not None]
    nodes = [n for n in nodes if len(scene.beats(n)) >= 16]
    node = scene.choose(nodes)
    gone = {now for k, now in enumerate(scene.beats(node)) if k % 4}
    return scene.without(lambda each: is_from(each, 0x700 + node) and each.now in gone), _name(node)


@fault(Cause.STATE_LEFT)
def state_flaps(scene: Scene) -> Found:
    """A node says PRE-OPERATIONAL in every other heartbeat, and nobody commands it."""
    since = scene.somewhen()
    commands = [each for each in scene.frames if each.frame.can_id == 0 and each.now > since]
    nodes = [n for n in scene.slaves() if sum(now > since for now in scene.beats(n)) >= 6]
    if commands or not nodes:
        return None
    node = scene.random.choice(nodes)
    said = {now for k, now in enumerate(t for t in scene.beats(node) if t > since) if k % 2}
    return [
        changed(each, b"\x7f") if is_from(each, 0x700 + node) and each.now in said else each
        for each in scene.frames
    ], _name(node)


@fault(Cause.HEARTBEAT_LOST)
def master_dies(scene: Scene) -> Found:
    """The master, which has a heartbeat of its own, sends nothing more; the slaves go on."""
    asked = set(scene.slaves())
    masters = [n for n in scene.beating() if n not in asked]
    since = scene.somewhen()
    if not masters or scene.end - since < 5 * scene.period(0x700 + masters[-1]):
        return None
    master = masters[-1]

    def is_its(each: LoggedFrame) -> bool:
        can_id = each.frame.can_id
        return sender(each) == master or can_id in {0x000, 0x080} or 0x600 < can_id < 0x680

    left = scene.without(lambda each: each.now > since and is_its(each))
    followers = scene.times(0x080)
    if followers:  # what follows SYNC stops with it
        timed = {
            0x180 + n
            for n in asked
            if (kind := scene.download(n, 0x1800, 2)) is not None and kind.value in range(1, 241)
        }
        left = [each for each in left if each.now < since or each.frame.can_id not in timed]
    return left, _name(master)


@fault(Cause.NOT_STARTED)
def reset_and_forgotten(scene: Scene) -> Found:
    """The master resets a node in the middle, and neither configures nor starts it again."""
    since = scene.somewhen(0.3, 0.4)
    nodes = scene.slaves()
    later = [each for each in scene.frames if each.frame.can_id == 0 and each.now > since]
    if len(nodes) < 2 or later or scene.end - since < 1400 * MS:
        return None
    node = scene.random.choice(nodes)
    identifier = scene.download(node, 0x1800, 1)
    if identifier is not None and identifier.value & 0x7FF != 0x180 + node:
        return None  # its PDOs are not known by their identifiers
    left = scene.without(lambda each: each.now > since and sender(each) == node)
    boot = since + 60 * MS
    added = [(since, Frame(0x000, bytes([0x82, node]))), (boot, Frame(0x700 + node, b"\0"))]
    return merged(left, added), _name(node)


@fault(Cause.EMCY)
def bus_off_reported(scene: Scene) -> Found:
    """A node is away for three heartbeats, and says EMCY 0x8140, recovered from bus-off."""
    nodes = scene.slaves()
    node = scene.choose(nodes)
    since, period = scene.somewhen(0.3, 0.4), scene.period(0x700 + node)
    until = since + 2 * period
    if until + 2 * period > scene.end:
        return None
    left = scene.without(lambda each: since < each.now < until and sender(each) == node)
    emcy = (until, Frame(0x080 + node, bytes.fromhex("4081110000000000")))
    return merged(left, [emcy]), _name(node)


@fault(Cause.J1939_TRANSFER)
def transfer_aborted(scene: Scene) -> Found:
    """The receiver of a long message aborts it after the first packet: out of resources."""
    for place, each in enumerate(scene.frames):
        frame = each.frame
        if not frame.is_extended or frame.can_id >> 16 & 0xFF != 0xEC or frame.data[0] != 0x10:
            continue
        to, source, group = frame.can_id >> 8 & 0xFF, frame.can_id & 0xFF, frame.data[5:8]
        abort = Frame(
            0x18EC0000 | source << 8 | to, b"\xff\x02\xff\xff\xff" + group, is_extended=True
        )
        end = next(
            (
                k
                for k in range(place + 1, len(scene.frames))
                if scene.frames[k].frame.is_extended
                and scene.frames[k].frame.can_id & 0xFFFFFF == 0xEC0000 | source << 8 | to
                and scene.frames[k].frame.data[0] in {0x13, 0xFF}
            ),
            None,
        )
        data = [
            k
            for k in range(place, end or place)
            if scene.frames[k].frame.can_id >> 16 & 0xFF == 0xEB
        ]
        if end is None or len(data) < 2:
            continue
        kinds = {0xEB, 0xEC}
        pair = {to, source}
        kept = [
            e
            for k, e in enumerate(scene.frames)
            if not (
                data[0] < k <= end
                and e.frame.is_extended
                and e.frame.can_id >> 16 & 0xFF in kinds
                and {e.frame.can_id >> 8 & 0xFF, e.frame.can_id & 0xFF} == pair
            )
        ]
        return merged(kept, [(scene.frames[data[0]].now + MS, abort)]), f"{source}"
    return None


@fault(Cause.J1939_REQUEST)
def request_refused(scene: Scene) -> Found:
    """A tool asks a device for its software identification, and gets a negative acknowledgement."""
    sources = sorted(
        {
            each.frame.can_id & 0xFF
            for each in scene.frames
            if each.frame.is_extended and each.frame.can_id >> 16 & 0xFF >= 0xF0
        }
    )
    device, at = scene.choose(sources), scene.end * 3 // 10
    asked = Frame(0x18EA00F9 | device << 8, bytes.fromhex("DAFE00"), is_extended=True)
    said = Frame(0x18E8FF00 | device, bytes.fromhex("01FFFFFFF9DAFE00"), is_extended=True)
    return merged(scene.frames, [(at, asked), (at + 20 * MS, said)]), "249"


@fault(Cause.SDO_SHARED)
def two_clients_at_once(scene: Scene) -> Found:
    """A second tool reads 0x1001 of a node while the master writes to it; both get their answer."""
    written = [(n, d) for n in scene.slaves() for d in scene.downloads(n)[-1:]]
    written = [
        (n, d)
        for n, d in written
        if scene.frames[d.answer].now > scene.frames[d.place].now + 20_000
    ]
    if not written:
        return None
    node, download = scene.random.choice(written)
    asked = scene.frames[download.place].now + 10_000
    added = [
        (asked, Frame(0x600 + node, bytes.fromhex("4001100000000000"))),
        (
            scene.frames[download.answer].now + 10_000,
            Frame(0x580 + node, bytes.fromhex("4F01100000000000")),
        ),
    ]
    return merged(scene.frames, added), _name(node)
