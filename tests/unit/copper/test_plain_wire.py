"""The bus of copper beside a plain one, which looks at all stations at each frame.

Its rules are those of ISO 11898-1: dominant bits win, five equal bits are stuffed, an error flag
has six bits, and counters go by 8 and 1. A bit is 1 us.
"""

import random
from dataclasses import dataclass, field

import pytest

from hil_bench.abilities.copper.wire.attempt import disturbed, misread
from hil_bench.abilities.copper.wire.bits import exact_bits, stuffed_bits
from hil_bench.abilities.copper.wire.station import Order, Station
from hil_bench.abilities.copper.wire.wire import Wire
from hil_bench.canopen_device.agenda import NEVER
from hil_bench.canopen_device.emcy import CanEvent
from hil_bench.canopen_device.frame import Frame

US = 1000
LONG = 10**12
SEEDS = 24
AFTER = 8 + 3  # delimiter and intermission


def flags(bits, place, sees, active):
    """Put flags on a bus bit by bit; return how many bits pass from behind `place` to their end.

    Args:
        bits: on the bus up to `place`, then those that the sender still sends.
        sees: the station that notices an error at `place`; 0 is the sender.
        active: which stations send dominant flags.
    """
    bus, begun, time = bits[:place], {}, place
    while len(begun) < len(active):
        own = bits[time] if time < len(bits) and begun.get(0, LONG) > time else 1
        dominant = [at for each, at in begun.items() if active[each] and at <= time < at + 6]
        bus.append(0 if dominant else own)
        for each in set(range(len(active))) - set(begun):
            is_run = bus[-6:] in ([0] * 6, [1] * 6)
            if (each == sees and time == place) or (bus[-1] != own if each == 0 else is_run):
                begun[each] = time + 1
        time += 1
    return max(at + 6 for at in begun.values()) - place - 1


def some_bits(dice):
    data = dice.choice((bytes(8), b"\xff" * 5, dice.randbytes(dice.randrange(9))))
    return stuffed_bits(Frame(dice.choice((0, 0x7FF, dice.randrange(0x800))), data))


def test_the_flags_on_a_bus_bit_by_bit_end_where_an_error_ends():
    dice = random.Random(2)  # noqa: S311 - no secrets
    for _ in range(150):
        bits = some_bits(dice)
        place = dice.randrange(len(bits))
        wrong = [*bits[:place], 1 - bits[place]]
        for is_passive in (False, True):
            end = disturbed(bits, place, is_passive=is_passive, has_active_others=True)
            length = flags(wrong, place, 0, [not is_passive, True, True])
            assert (end.position, end.length) == (place, place + 1 + length + AFTER)
        alone = disturbed(bits, place, is_passive=True, has_active_others=False)
        assert alone.length == place + 1 + 6 + AFTER
        late = disturbed(bits, len(bits), is_passive=False, has_active_others=True)
        assert late.length == len(bits) + 1 + 6 + AFTER  # a form error: all at once
        end = misread(bits, place)
        length = flags([*bits, 1], place, 1, [True, True, True])
        assert (end.position, end.length) == (place, place + 1 + length + AFTER)


def identifier(frame):
    """Return the bits that decide an arbitration: 0 wins."""
    if not frame.is_extended:
        return f"{frame.can_id:011b}{frame.is_remote:d}0"
    bits = f"{frame.can_id:029b}"
    return f"{bits[:11]}11{bits[11:]}{frame.is_remote:d}"


@dataclass(eq=False)
class Plain:
    """A station of the plain bus; its times are in bits."""

    name: str
    depth: int
    order: Order
    sends: dict = field(default_factory=dict)  # shares where what it sends is disturbed
    reads: dict = field(default_factory=dict)  # and where it misreads
    queue: list = field(default_factory=list)  # identifier, number, release, frame
    sending: tuple | None = None
    tec: int = 0
    rec: int = 0
    sent: int = 0
    refused: int = 0
    errors: int = 0
    missed: int = 0
    ready: float = 0
    off_since: int | None = None
    left: int = 0  # sequences of recessive bits until it is back
    has_overrun: bool = False
    told: list = field(default_factory=list)

    is_off = property(lambda self: self.off_since is not None)
    is_passive = property(lambda self: max(self.tec, self.rec) > 127)
    back = property(lambda self: self.off_since + 11 * self.left)
    head = property(lambda self: self.queue[0] if self.order is Order.FIFO else min(self.queue))


class PlainBus:
    def __init__(self, stations, gaps, recovery):
        self.stations, self.gaps, self.recovery = stations, gaps, recovery
        self.gap = next(gaps) if gaps else None
        self.passed, self.broken, self.free, self.numbers = [], [], 0, 0

    def put(self, time, station, frame):
        self.numbers += 1
        new = (identifier(frame), self.numbers, time, frame)
        if len(station.queue) + (station.sending is not None) >= station.depth:
            station.refused += 1
            station.told += [CanEvent.OVERRUN] * (not station.has_overrun)
            station.has_overrun = True
            last = max(station.queue, default=("",))
            if station.order is Order.FIFO or last[0] <= new[0]:
                return
            station.queue.remove(last)
        station.queue.append(new)

    def count(self, station, tec, rec):
        was = station.is_passive
        station.tec = max(station.tec + tec, 0)
        station.rec = 127 if rec < 0 and station.rec > 127 else min(max(station.rec + rec, 0), 255)
        if station.tec > 255:
            station.off_since, station.left = self.free + self.recovery, 128
            station.told.append(CanEvent.BUS_OFF)
        elif was != station.is_passive:
            station.told.append(CanEvent.ACTIVE if was else CanEvent.PASSIVE)

    def play(self, puts):
        now = 0
        while True:
            while puts and puts[0][0] <= now:
                self.put(*puts.pop(0))
            for each in self.stations:
                if each.is_off and each.back <= now:
                    each.off_since, each.tec, each.rec = None, 0, 0
                    each.told.append(CanEvent.RECOVERED)
            there = [each for each in self.stations if not each.is_off]
            for each in there if len(there) > 1 else ():
                each.ready = 0 if each.ready == NEVER else each.ready
            able = [each for each in there if each.queue and each.ready <= now]
            if able:
                now = self.transmit(min(able, key=lambda each: each.head), now, puts)
                continue
            times = [each.back for each in self.stations if each.is_off]
            times += [each.ready for each in there if each.queue] + [each[0] for each in puts[:1]]
            if min(times, default=NEVER) == NEVER:
                return
            now = min(times)

    def outcome(self, sender, frame, others):
        """Return the end of a transmission: kind, place, length, who broke it, who is deaf."""
        bits = stuffed_bits(frame)
        if not others:
            return "no acknowledge", len(bits) + 1, len(bits) + 2 + 6 + AFTER, None, []
        share = sender.sends[frame.can_id].pop() if sender.sends.get(frame.can_id) else None
        place = None if share is None else int(share * (len(bits) + 9))
        if share is None and self.gap is not None:
            if self.gap < len(bits) + 9:
                place, self.gap = self.gap, next(self.gaps)
            else:
                self.gap -= len(bits) + 9
        if place is not None:
            length = 6
            if place < len(bits) and not all(each.is_passive for each in others):
                wrong = [*bits[:place], 1 - bits[place]]
                length = flags(wrong, place, 0, [not sender.is_passive, True])
            return "bit error", place, place + 1 + length + AFTER, None, []
        shares = {
            each: each.reads[frame.can_id].pop() for each in others if each.reads.get(frame.can_id)
        }
        deaf = [each for each in shares if each.is_passive]
        culprit = next((each for each in shares if not each.is_passive), None)
        if culprit is None:
            return None, None, exact_bits(frame), None, deaf
        place = int(shares[culprit] * len(bits))
        length = flags([*bits, 1], place, 1, [True] * 3)
        return "stuff error", place, place + 1 + length + AFTER, culprit, []

    def transmit(self, sender, begin, puts):
        sender.sending = pending = sender.head
        sender.queue.remove(pending)
        _, _, released, frame = pending
        others = [each for each in self.stations if each is not sender and not each.is_off]
        absent = [each for each in self.stations if each.is_off]
        kind, place, length, culprit, deaf = self.outcome(sender, frame, others)
        end = self.free = begin + length
        while puts and puts[0][0] < end:
            self.put(*puts.pop(0))
        for each in absent:
            if end > each.off_since:  # idle sequences before, and one at its end
                each.left = max(0, each.left - max(0, begin - each.off_since) // 11 - 1)
                each.off_since = end
        sender.sending = None
        if kind is None:
            sender.sent += 1
            self.count(sender, -1, 0)
            for each in others:
                each.missed += each in deaf
                self.count(each, 0, 1 if each in deaf else -1)
            if sender.has_overrun and not sender.queue:
                sender.has_overrun = False
                sender.told.append(CanEvent.SENT_ALL)
            gone = {each.name for each in (*deaf, *absent)}
            self.passed.append((frame, sender.name, released, begin, end, gone))
        else:
            sender.queue.insert(0, pending)
            sender.errors += 1
            is_alone = kind == "no acknowledge" and sender.is_passive
            for each in others:
                self.count(each, 0, 9 if each is culprit else 1)
            self.count(sender, 0 if is_alone else 8, 0)
            sender.ready = NEVER if is_alone else sender.ready
            self.broken.append((kind, place, frame, sender.name, begin, end))
        if sender.is_passive and not sender.is_off and sender.ready != NEVER:
            sender.ready = end + 8
        return end


KEPT = ["tec", "rec", "sent", "refused", "errors", "missed", "is_off", "is_passive", "has_overrun"]


@pytest.mark.parametrize("seed", range(SEEDS))
def test_a_bus_does_what_a_plain_one_does(seed):
    dice = random.Random(seed)  # noqa: S311 - no secrets
    names = "abcd"[: dice.randint(2, 4)]
    plain, real = [], []
    for name in names:
        depth, order = dice.choice((1, 3, 100)), dice.choice(list(Order))
        rules = [{}, {}]
        for shares in rules if dice.random() < 0.5 else ():
            for can_id in range(0x100, 0x108):
                shares[can_id] = [dice.random() for _ in range(dice.choice((0, 2, 20)))]
        plain.append(
            Plain(name, depth, order, *({k: v.copy() for k, v in r.items()} for r in rules))
        )
        station = Station(name, depth, order)
        for shares, to in zip(rules, (station.send_rules, station.receive_rules), strict=True):
            to.append(
                lambda frame, s=shares: s[frame.can_id].pop() if s.get(frame.can_id) else None
            )
        real.append(station)
    puts, now = [], 0
    for number in range(60):
        now += dice.choice((0, 1, 100, 2000))
        place = dice.randrange(len(names))
        can_id = 0x100 + 4 * dice.randrange(3) + place
        frame = dice.choice(
            (
                Frame(can_id, dice.randbytes(dice.randrange(9))),
                Frame(can_id << 18 | place, bytes([number]), is_extended=True),
                Frame(can_id, is_remote=True),
            )
        )
        puts.append((now, place, frame))
    gaps = dice.choice((None, [int(dice.expovariate(1 / 800)) for _ in range(20_000)]))
    recovery = dice.choice((0, 5000))
    bus = PlainBus(plain, iter(gaps) if gaps else None, recovery)
    bus.play([(time, plain[place], frame) for time, place, frame in puts])
    chance = iter(gaps).__next__ if gaps else None
    wire = Wire(1_000_000, real, chance=chance, recovery=recovery * US)
    told, errors, passed = {name: [] for name in names}, [], []
    wire.on_event = lambda station, event: told[station.name].append(event)
    wire.on_error = errors.append
    for time, place, frame in puts:
        passed += wire.run(time * US)
        wire.put(real[place], frame, time * US)
    passed += wire.run(LONG)
    assert [
        (
            e.frame,
            e.station.name,
            e.released // US,
            e.begin // US,
            e.end // US,
            {d.name for d in e.deaf},
        )
        for e in passed
    ] == bus.passed
    assert [
        (e.broken.kind, e.broken.position, e.frame, e.station.name, e.begin // US, e.end // US)
        for e in errors
    ] == bus.broken
    assert told == {each.name: each.told for each in plain}
    for key in KEPT:
        assert [getattr(each, key) for each in real] == [getattr(each, key) for each in plain], key
    assert (wire.passed, wire.failed) == (len(passed), len(errors))
