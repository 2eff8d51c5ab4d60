"""Faults of J1939 devices."""

import itertools

from corpus.faults import MS, Found, Scene, changed, fault, merged
from corpus.j1939_scene import is_from
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import LoggedFrame

_TRANSPORT = frozenset({0xEB, 0xEC})
_CLAIM = 0xEE


def _format(each: LoggedFrame) -> int:
    return each.frame.can_id >> 16 & 0xFF


def _cyclic(scene: Scene) -> dict[int, list[int]]:
    """Return the times of the messages that came at least twelve times, by identifier."""
    found: dict[int, list[int]] = {}
    for each in scene.frames:
        if each.frame.is_extended and _format(each) not in _TRANSPORT and _format(each) >= 0xF0:
            found.setdefault(each.frame.can_id, []).append(each.now)
    return {can_id: times for can_id, times in found.items() if len(times) >= 12}


def _drawn(scene: Scene) -> tuple[int, int]:
    """Draw a cyclic message: its identifier and its period [ns]."""
    cyclic = _cyclic(scene)
    can_id = scene.choose(sorted(cyclic))
    times = cyclic[can_id]
    return can_id, sorted(b - a for a, b in itertools.pairwise(times))[len(times) // 2]


def _address(can_id: int) -> str:
    return f"{can_id & 0xFF}"


@fault(Cause.J1939_SILENT)
def ecu_falls_silent(scene: Scene) -> Found:
    """A device sends nothing from the middle on."""
    found, since = _drawn(scene), scene.end * 45 // 100
    if scene.end - since < 1300 * MS or len({c & 0xFF for c in _cyclic(scene)}) < 2:
        return None
    return scene.without(lambda e: e.now > since and is_from(e, found[0] & 0xFF)), _address(
        found[0]
    )


@fault(Cause.J1939_MISSING)
def message_stays_out(scene: Scene) -> Found:
    """A cyclic message stays out for six periods."""
    found, since = _drawn(scene), scene.end * 6 // 10
    if since + 7 * found[1] > scene.end:
        return None
    until = since + 6 * found[1]
    return scene.without(lambda e: since < e.now < until and e.frame.can_id == found[0]), _address(
        found[0]
    )


@fault(Cause.J1939_TRANSFER)
def packet_lost(scene: Scene) -> Found:
    """A data packet of a long message is lost, and its receiver gives no sign."""
    places = [
        k
        for k, e in enumerate(scene.frames)
        if e.frame.is_extended and _format(e) == 0xEB and e.frame.data[0] == 2
    ]
    if not places:
        return None
    frames = list(scene.frames)
    gone = frames[places[0]]
    return [e for e in frames if e is not gone], _address(gone.frame.can_id)


@fault(Cause.ADDRESS_CLASH)
def address_taken(scene: Scene) -> Found:
    """A device of a greater NAME claims the address of another, and goes on sending."""
    claims = [
        e
        for e in scene.frames
        if e.frame.is_extended and _format(e) == _CLAIM and e.frame.can_id & 0xFF < 254
    ]
    if not claims or scene.end < 2500 * MS:
        return None
    claim, at = claims[0], scene.end * 4 // 10
    other = bytes([*claim.frame.data[:7], claim.frame.data[7] | 0x80])
    if other == claim.frame.data:
        return None
    added = [(at, changed(claim, other).frame), (at + 2 * MS, claim.frame)]
    return merged(scene.frames, added), _address(claim.frame.can_id)


@fault(Cause.J1939_REQUEST)
def request_without_answer(scene: Scene) -> Found:
    """A tool asks a device for its software identification twice, and nothing comes."""
    found, at = _drawn(scene), scene.end * 3 // 10
    if scene.end - at < 1800 * MS:
        return None
    asked = Frame(0x18EA00F9 | (found[0] & 0xFF) << 8, bytes.fromhex("DAFE00"), is_extended=True)
    return merged(scene.frames, [(at, asked), (at + 200 * MS, asked)]), "249"


@fault(Cause.TROUBLE_CODE)
def trouble_code(scene: Scene) -> Found:
    """A device says by DM1 that SPN 110 is above its range, each second."""
    found = _drawn(scene)
    if any(e.frame.is_extended and e.frame.can_id & 0xFFFF00 == 0xFECA00 for e in scene.frames):
        return None
    source = found[0] & 0xFF
    said = Frame(0x18FECA00 | source, bytes.fromhex("04FF6E000001FFFF"), is_extended=True)
    times = range(scene.end * 3 // 10, scene.end, 1000 * MS)
    return merged(scene.frames, [(now, said) for now in times]), _address(source)
