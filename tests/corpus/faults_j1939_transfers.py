"""Faults of long J1939 messages: packets, sequence, pace, time-outs T1 to T4, aborts."""

from corpus.faults import MS, Found, Frames, Scene, changed, fault_of_j1939, merged
from corpus.j1939_scene import (
    ALL,
    CONTROL,
    PACKET,
    Blamed,
    Session,
    fault_of_a_transfer,
    is_of,
    pdu_format,
    senders,
)
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.outside.recording.channels import LoggedFrame

_TIMEOUT, _RESOURCES, _BAD_SEQUENCE = 3, 2, 7
_T1, _T2, _T3, _T4 = 750, 1250, 1250, 1050
_BROADCAST = 0xFEE3


def _broadcasts(frames: Frames) -> dict[int, list[list[LoggedFrame]]]:
    """Return the packets of each whole BAM, by its sender."""
    found: dict[int, list[list[LoggedFrame]]] = {}
    for each in frames:
        if not each.frame.is_extended or each.frame.can_id >> 8 & 0xFF != ALL:
            continue
        source = each.frame.can_id & 0xFF
        if is_of(each, CONTROL, source) and each.frame.data[0] == 32:
            found.setdefault(source, []).append([each])
        elif is_of(each, PACKET, source) and source in found:
            found[source][-1].append(each)
    return {
        source: [s for s in sessions if len(s) == s[0].frame.data[3] + 1]
        for source, sessions in found.items()
    }


def _one_broadcast(scene: Scene, fewest: int) -> list[LoggedFrame]:
    """Draw a BAM of some packets, its announcement first."""
    found = [
        s
        for _, sessions in sorted(_broadcasts(scene.frames).items())
        for s in sessions
        if len(s) > fewest and s[-1].now < scene.end - 1500 * MS
    ]
    return scene.choose(found)


@fault_of_j1939(Cause.J1939_TRANSFER)
def packet_of_a_broadcast_is_lost(scene: Scene) -> Found:
    """One packet of a BAM is lost: the first, the last or one between."""
    found = _one_broadcast(scene, 2)
    gone = scene.random.choice(found[1:])
    return [e for e in scene.frames if e is not gone], f"{gone.frame.can_id & 0xFF}"


@fault_of_j1939(Cause.J1939_TRANSFER)
def packets_in_wrong_order(scene: Scene) -> Found:
    """Two packets of a BAM change places, or one comes in place of the one before it."""
    found = _one_broadcast(scene, 3)
    at = scene.random.randrange(1, len(found) - 2)
    one, other = found[at], found[at + 1]
    frames = list(scene.frames)
    places = [k for k, e in enumerate(frames) if e is one or e is other]
    first, second = one.frame.data, other.frame.data
    frames[places[0]] = changed(one, second)
    frames[places[1]] = changed(other, first if scene.random.random() < 0.5 else second)
    return frames, f"{one.frame.can_id & 0xFF}"


def _paced(scene: Scene, every: float) -> Found:
    """Add BAMs of a device that has none, with a time between packets [ms]."""
    busy = {e.frame.can_id & 0xFF for e in scene.frames if pdu_format(e) in {0xEB, 0xEC}}
    free = [each for each in senders(scene) if each not in busy]
    source, size = scene.choose(free), int(scene.share(40, 90))
    lasts = int((-(-size // 7) + 1) * every * MS)
    frames, now = list(scene.frames), 1500 * MS
    while now + lasts < scene.end - 1000 * MS:
        session = Session(source, ALL, size, now, _BROADCAST).announce()
        frames = merged(frames, session.packets(range(1, session.count + 1), every).frames)
        now += max(lasts + 900 * MS, 2000 * MS)
    return (frames, f"{source}") if len(frames) > len(scene.frames) else None


@fault_of_j1939(Cause.J1939_PACE)
def broadcast_too_fast(scene: Scene) -> Found:
    """The packets of a BAM follow each other in less than 10 ms."""
    return _paced(scene, scene.share(0.6, 7.0))


@fault_of_j1939(Cause.J1939_PACE)
def broadcast_too_slow(scene: Scene) -> Found:
    """The packets of a BAM are more than 200 ms apart."""
    return _paced(scene, scene.share(260.0, 700.0))


@fault_of_a_transfer(5000)
def no_clear_to_send(scene: Scene, session: Session) -> Blamed:
    """Nobody answers an RTS; its sender aborts after T3, or begins anew."""
    session.announce().wait(_T3 + 5)
    if scene.random.random() < 0.5:
        session.abort(session.a, _TIMEOUT)
    else:
        session.announce().wait(_T3 + 5).announce()
    return session.b


@fault_of_a_transfer()
def sender_stops_between_packets(scene: Scene, session: Session) -> Blamed:
    """The sender of a long message stops after some packets; the receiver aborts after T1."""
    last = 1 + scene.random.randrange(session.count - 1)
    session.announce().wait(4).clear(session.count, 1).packets(range(1, last + 1), 5)
    session.wait(_T1 + scene.share(1, 30)).abort(session.b, _TIMEOUT)
    return session.a


@fault_of_a_transfer()
def no_packet_after_clear_to_send(scene: Scene, session: Session) -> Blamed:
    """The sender of a long message sends nothing after the CTS; the receiver aborts after T2."""
    session.announce().wait(4).clear(min(session.count, 16), 1)
    session.wait(_T2 + scene.share(1, 30)).abort(session.b, _TIMEOUT)
    return session.a


@fault_of_a_transfer(6000)
def no_end_of_message(scene: Scene, session: Session) -> Blamed:
    """All packets have come, and the receiver says nothing; the sender aborts after T3."""
    session.announce().wait(4).clear(session.count, 1).packets(range(1, session.count + 1), 4)
    session.wait(_T3 + scene.share(1, 30)).abort(session.a, _TIMEOUT)
    return session.b


@fault_of_a_transfer(6000)
def receiver_holds_for_ever(scene: Scene, session: Session) -> Blamed:
    """The receiver says "wait" some times, then nothing; the sender aborts after T4."""
    session.announce()
    for _ in range(1 + scene.random.randrange(3)):
        session.wait(scene.share(100, 450)).clear(0, 0xFF)
    session.wait(_T4 + scene.share(1, 30)).abort(session.a, _TIMEOUT)
    return session.b


@fault_of_a_transfer()
def receiver_refuses(scene: Scene, session: Session) -> Blamed:
    """The receiver aborts at the RTS, or in the middle: busy, out of resources, or another."""
    session.announce().wait(scene.share(2, 40))
    if scene.random.random() < 0.5:
        last = 1 + scene.random.randrange(session.count - 1)
        session.clear(session.count, 1).packets(range(1, last + 1), 5).wait(3)
    session.abort(session.b, scene.random.choice((1, _RESOURCES, 4, 250)))
    return f"{session.a}|{session.b}"


@fault_of_a_transfer()
def packet_is_left_out(scene: Scene, session: Session) -> Blamed:
    """The sender leaves a packet out, and the receiver aborts at the next: bad sequence number."""
    gone = 1 + scene.random.randrange(session.count - 1)
    session.announce().wait(4).clear(session.count, 1).packets(range(1, gone), 5)
    session.wait(5).packet(gone + 1).wait(2).abort(session.b, _BAD_SEQUENCE)
    return session.a


@fault_of_a_transfer()
def begun_anew_before_its_end(scene: Scene, session: Session) -> Blamed:
    """The sender begins the message anew before it has ended, and the second one arrives."""
    last = 1 + scene.random.randrange(session.count - 1)
    session.announce().wait(4).clear(session.count, 1).packets(range(1, last + 1), 5)
    session.wait(scene.share(20, 300)).announce().wait(4).clear(session.count, 1)
    session.packets(range(1, session.count + 1), 4).wait(3).end()
    return session.a
