"""Modbus clients for a device of registers that are all the same: honest ones, and others.

An honest client asks what it may, in requests that follow each other without waiting, and checks
each response against what it wrote before. The others send what no client should.
"""

import struct
from collections import deque
from dataclasses import dataclass, field

UNIT, OTHER_UNIT, NO_UNIT = 1, 2, 77
BLOCK = 4
"""Holding registers that belong to one client."""
INPUTS = 8

_UNKNOWN = None


def frame(transaction, pdu, unit_id=UNIT):
    return struct.pack(">HHHB", transaction, 0, len(pdu) + 1, unit_id) + pdu


def read(function, address, count):
    return struct.pack(">BHH", function, address, count)


def write(address, *words):
    count = len(words)
    return struct.pack(f">BHHB{count}H", 16, address, count, 2 * count, *words)


@dataclass
class Ledger:
    """What all clients did, to be compared with what the device did.

    Attributes:
        next_value: each written value is another one, from 1 up to what a register holds.
        answered: requests of honest clients that got their responses.
        acknowledged: values whose writes were acknowledged.
        refused: exceptions that an honest client got for what it may do.
        faults: what should not have been, in words.
    """

    next_value: int = 1
    answered: int = 0
    acknowledged: list = field(default_factory=list)
    refused: list = field(default_factory=list)
    faults: list = field(default_factory=list)

    def value(self):
        self.next_value += 1
        return self.next_value - 1


class Conversation:
    """The requests of an honest client on one connection, and the responses that it is due.

    Args:
        ledger: takes what happens.
        block: number of the registers that are its own.
        dice: choose the requests.
        is_alone: whether nobody else writes these registers, as a write of an earlier connection
            may that was under way when the server died.
    """

    def __init__(self, ledger, block, dice, *, is_alone=True):
        self._ledger = ledger
        self._base = block * BLOCK
        self._dice = dice
        self._is_alone = is_alone
        self._due = deque()
        self._buffer = bytearray()
        self._transaction = dice.randrange(0x10000)
        self._registers = [_UNKNOWN] * BLOCK

    @property
    def is_answered(self):
        return not self._due

    @property
    def due(self):
        return len(self._due)

    def ask(self):
        """Return the frame of a new request."""
        make = self._dice.choice(
            (
                self._read,
                self._read,
                self._write,
                self._write_one,
                self._mask,
                self._both,
                self._odd,
            )
        )
        pdu, check, unit_id = make()
        self._transaction = (self._transaction + 1) & 0xFFFF
        self._due.append((self._transaction, unit_id, pdu, check))
        return frame(self._transaction, pdu, unit_id)

    def take(self, data):
        """Take what came, and compare it with what is due."""
        self._buffer += data
        while len(self._buffer) >= 8 and len(self._buffer) >= 6 + self._buffer[5]:
            transaction, protocol, length, unit_id = struct.unpack_from(">HHHB", self._buffer)
            pdu = bytes(self._buffer[7 : 6 + length])
            del self._buffer[: 6 + length]
            self._compare(transaction, protocol, unit_id, pdu)

    def _compare(self, transaction, protocol, unit_id, pdu):
        if not self._due:
            self._ledger.faults.append(f"a response that nobody asked for: {pdu.hex(' ')}")
            return
        wanted, to_unit, request, check = self._due.popleft()
        if (transaction, protocol, unit_id) != (wanted, 0, to_unit):
            self._ledger.faults.append(f"response {transaction} to request {wanted}")
            return
        self._ledger.answered += 1
        if pdu[0] == request[0] | 0x80 and pdu[1] in {4, 6}:
            self._ledger.refused.append(pdu.hex(" "))
            self._registers = [_UNKNOWN] * BLOCK  # it may have been obeyed after all
        elif not check(pdu):
            self._ledger.faults.append(f"{request.hex(' ')} was answered by {pdu.hex(' ')}")

    def _read(self):
        if self._dice.random() < 0.3:
            pdu = read(4, 0, INPUTS)
            return pdu, lambda answer: answer[:2] == bytes([4, 2 * INPUTS]), UNIT
        return read(3, self._base, BLOCK), lambda answer: self._is_block(3, answer), UNIT

    def _is_block(self, function, answer):
        if len(answer) != 2 + 2 * BLOCK or answer[:2] != bytes([function, 2 * BLOCK]):
            return False
        found = struct.unpack(f">{BLOCK}H", answer[2:])
        is_right = all(
            known in {_UNKNOWN, word} for known, word in zip(self._registers, found, strict=True)
        )
        if self._is_alone:
            self._registers = list(found)
        return is_right

    def _acknowledge(self, place, values):
        self._registers[place : place + len(values)] = values
        self._ledger.acknowledged += values

    def _write(self):
        count = self._dice.randint(1, BLOCK)
        values = [self._ledger.value() for _ in range(count)]
        pdu = write(self._base, *values)

        def check(answer):
            self._acknowledge(0, values)
            return answer == pdu[:5]

        return pdu, check, UNIT

    def _write_one(self):
        place, value = self._dice.randrange(BLOCK), self._ledger.value()
        pdu = struct.pack(">BHH", 6, self._base + place, value)

        def check(answer):
            self._acknowledge(place, [value])
            return answer == pdu

        return pdu, check, UNIT

    def _mask(self):
        place, value = self._dice.randrange(BLOCK), self._ledger.value()
        pdu = struct.pack(">BHHH", 22, self._base + place, 0, value)

        def check(answer):
            self._acknowledge(place, [value])
            return answer == pdu

        return pdu, check, UNIT

    def _both(self):
        value = self._ledger.value()
        head = struct.pack(">BHHHHB", 23, self._base, BLOCK, self._base, 1, 2)

        def check(answer):
            self._acknowledge(0, [value])
            return self._is_block(23, answer)

        return head + value.to_bytes(2, "big"), check, UNIT

    def _odd(self):
        """What is refused, and how."""
        pdu, answer, unit_id = self._dice.choice(
            (
                (read(3, 0x7000, 1), "83 02", UNIT),
                (read(3, 0, 126), "83 03", UNIT),
                (b"\x09\x00", "89 01", UNIT),
                (read(4, 0, 1), "84 0b", NO_UNIT),
                (b"\x2b\x0e\x04\x01", "2b 0e 04 82 00 00 01 01 01 63", UNIT),
            )
        )
        return pdu, lambda found: found == bytes.fromhex(answer), unit_id


def attack(ledger, block, dice):
    """Yield what a bad client sends, and "read", "wait", "eof" or "reset" for what else it does."""
    return dice.choice(_ATTACKS)(ledger, block * BLOCK, dice)


def _garbage_behind_a_write(ledger, base, dice):
    """The write waits for the loop, and what is behind it waits too."""
    yield frame(7, write(base, ledger.value())) + dice.randbytes(dice.randint(7, 40))


def _noise(_ledger, _base, dice):
    yield dice.randbytes(dice.randint(1, 600))


def _half_a_request(ledger, base, dice):
    whole = frame(7, write(base, ledger.value()))
    yield whole[: dice.randrange(1, len(whole))]
    yield "wait"


def _a_long_frame(_ledger, _base, dice):
    yield b"\0\1\0\0\xff\xff\1" + bytes(dice.randint(0, 5000))


def _responses_unread(_ledger, _base, _dice):
    for _ in range(200):
        yield frame(8, read(4, 0, INPUTS)) * 20
    yield "wait"


def _writes_and_a_reset(ledger, base, dice):
    yield b"".join(frame(n, write(base, ledger.value())) for n in range(dice.randint(2, 30)))
    yield "reset"


def _half_closed_in_a_request(ledger, base, dice):
    request = frame(8, read(4, 0, INPUTS))
    yield frame(7, write(base, ledger.value())) + request[: dice.randrange(len(request))]
    yield "eof"
    yield "read"


def _anything_in_whole_frames(_ledger, _base, dice):
    """For a unit that nobody else uses."""
    for number in range(30):
        function = dice.choice((1, 2, 3, 4, 5, 6, 15, 16, 22, 23, 43, dice.randrange(256)))
        yield frame(number, bytes([function]) + dice.randbytes(dice.randint(0, 20)), OTHER_UNIT)
    yield "read"


def _another_protocol(_ledger, _base, dice):
    yield frame(8, read(4, 0, INPUTS)) * dice.randint(1, 5) + b"GET / HTTP/1.1\r\n\r\n"


def _nothing(_ledger, _base, dice):
    yield dice.choice(("eof", "reset", "wait"))


_ATTACKS = (
    _garbage_behind_a_write,
    _noise,
    _half_a_request,
    _a_long_frame,
    _responses_unread,
    _writes_and_a_reset,
    _half_closed_in_a_request,
    _anything_in_whole_frames,
    _another_protocol,
    _nothing,
)
