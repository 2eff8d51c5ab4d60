"""FDCAN of STM32G0 and G4, with classical frames (reference manual RM0440, chapter 44).

Its message RAM has a fixed layout; it neither sends nor hears frames of CAN FD.
"""

from collections.abc import Sequence
from typing import Any, Final

from hil_bench.abilities.controllers.elf.core_view import Core
from hil_bench.abilities.controllers.elf.peripherals.registers import Peripheral
from hil_bench.abilities.controllers.elf.wire import Wire
from hil_bench.canopen_device.frame import Frame

RAM_BYTES: Final = 0x350
"""Of the message RAM, of one controller."""

DEPTH: Final = 3
"""Frames of a receive FIFO, of the transmit FIFO and of the list of events."""

_ELEMENT = 18  # words of a frame
_STANDARD, _EXTENDED, _FIFOS, _EVENTS, _BUFFERS = 0x00, 0x70, (0xB0, 0x188), 0x260, 0x278
_CCCR, _NBTP, _TSCV, _ECR, _PSR = 0x18, 0x1C, 0x24, 0x40, 0x44
_IR, _IE, _ILS, _ILE, _RXGFC, _XIDAM = 0x50, 0x54, 0x58, 0x5C, 0x80, 0x84
_RXFS, _RXFA = (0x90, 0x98), (0x94, 0x9C)
_TXBC, _TXFQS, _TXBRP, _TXBAR, _TXBCR, _TXBTO, _TXBCF = 0xC0, 0xC4, 0xC8, 0xCC, 0xD0, 0xD4, 0xD8
_TXBTIE, _TXEFS, _TXEFA = 0xDC, 0xE4, 0xE8
_INITIAL = {
    0x00: 0x3214_1218,
    0x04: 0x8765_4321,
    0x0C: 0x0000_0A33,
    _CCCR: 1,
    _NBTP: 0x0600_0A03,
    0x28: 0xFFFF_0000,
    0x2C: 0xFFFF,
    _PSR: 0x0707,
    _XIDAM: 0x1FFF_FFFF,
}
_INIT, _CCE, _CSR, _CSA = 1, 2, 16, 8
_NEW, _FULL, _LOST = 1, 2, 4
_HPM, _TC, _TCF, _TFE, _TEFN, _TEFF, _TEFL = (1 << place for place in range(6, 13))
# The bits of IR that each bit of ILS moves to the other line.
_GROUPS = (0x7, 0x38, 0x1C0, 0x1E00, 0xE000, 0x3_0000, 0xFC_0000)
_DISABLED = 3
_TO_FIFO = {1: 0, 2: 1, 5: 0, 6: 1}  # what a filter does with a frame
_STDID, _XTD, _RTR = 18, 1 << 30, 1 << 29


class Fdcan(Peripheral):
    """A controller.

    Args:
        core: that it belongs to.
        wire: the bus that it is on.
        interrupts: numbers of its two lines.
        ram: words of its message RAM.
    """

    def __init__(
        self,
        core: Core,
        wire: Wire,
        interrupts: Sequence[int],
        ram: Any,  # noqa: ANN401 - an array of ctypes
    ) -> None:
        self._core, self._wire, self._interrupts, self._ram = core, wire, interrupts, ram
        wire.receive = self._receive
        self.reset()

    def reset(self) -> None:
        """Go to the state behind power on."""
        self._values = dict(_INITIAL)
        self._counts, self._gets = [0, 0], [0, 0]
        self._requested: list[int] = []
        self._put = 0
        self._sending: int | None = None
        self._events = self._event_get = 0

    @property
    def is_on(self) -> bool:
        """Return True while it takes part in the bus."""
        return not self._values[_CCCR] & _INIT

    def load(self, offset: int) -> int:
        """Return a register."""
        if offset in _RXFS:
            return self._fifo_state(_RXFS.index(offset))
        if offset == _TXFQS:
            return self._transmit_state()
        if offset == _TXBRP:
            pending = (
                self._requested if self._sending is None else [*self._requested, self._sending]
            )
            return sum(1 << number for number in pending)
        if offset == _TXEFS:
            put = (self._event_get + self._events) % DEPTH
            full = 1 << 24 if self._events == DEPTH else 0
            return self._events | self._event_get << 8 | put << 16 | full
        if offset == _TSCV:
            return self._core.now() // 1000 & 0xFFFF
        return self._values.get(offset, 0)

    def store(self, offset: int, value: int) -> None:
        """Write a register."""
        values = self._values
        if offset == _IR:
            values[_IR] = values.get(_IR, 0) & ~value
            self._raise_lines()
        elif offset == _TXBAR:
            self._request(value)
        elif offset in _RXFA:
            self._release(_RXFA.index(offset), value & 7)
        elif offset == _TXBCR:
            self._cancel(value)
        elif offset == _TXEFA:
            released = (value - self._event_get) % DEPTH + 1
            self._events = max(self._events - released, 0)
            self._event_get = (value + 1) % DEPTH
        elif offset == _CCCR:
            self._control(value)
        elif offset in {_IE, _ILS, _ILE}:
            values[offset] = value
            self._raise_lines()
        else:
            values[offset] = value

    def _control(self, value: int) -> None:
        if not value & _INIT:
            value &= ~_CCE
        elif not self._values[_CCCR] & _INIT:  # into initialisation: what waited is lost
            self._counts, self._gets = [0, 0], [0, 0]
            self._requested, self._put, self._sending = [], 0, None
            self._events = self._event_get = 0
        value &= ~_CSA
        if value & _CSR:
            value |= _CSA | _INIT
        self._values[_CCCR] = value
        self._send_next()

    def _flag(self, bits: int) -> None:
        self._values[_IR] = self._values.get(_IR, 0) | bits
        self._raise_lines()

    def _raise_lines(self) -> None:
        values = self._values
        due = values.get(_IR, 0) & values.get(_IE, 0)
        second = sum(bits for place, bits in enumerate(_GROUPS) if values.get(_ILS, 0) >> place & 1)
        enabled = values.get(_ILE, 0)
        for line, bits in enumerate((due & ~second, due & second)):
            is_active = bool(bits and enabled >> line & 1)
            self._core.hold_line(self._interrupts[line], is_active=is_active)

    # To the bus.

    def _transmit_state(self) -> int:
        waiting = len(self._requested) + (self._sending is not None)
        free = DEPTH - waiting
        get, put = (self._put - waiting) % DEPTH, self._put
        if self._values.get(_TXBC, 0) >> 24 & 1:  # a queue: the first that is free
            busy = {*self._requested, self._sending}
            put = next((each for each in range(DEPTH) if each not in busy), 0)
            return put << 16 | (1 << 21 if not free else 0)
        return free | get << 8 | put << 16 | (1 << 21 if not free else 0)

    def _request(self, value: int) -> None:
        if not self.is_on:
            return
        for number in range(DEPTH):
            if value >> number & 1 and number not in self._requested and number != self._sending:
                self._requested.append(number)
                self._put = (number + 1) % DEPTH
                for name in (_TXBTO, _TXBCF):
                    self._values[name] = self._values.get(name, 0) & ~(1 << number)
        self._send_next()

    def _cancel(self, value: int) -> None:
        for number in [each for each in self._requested if value >> each & 1]:
            self._requested.remove(number)
            self._values[_TXBCF] = self._values.get(_TXBCF, 0) | 1 << number
            self._flag(_TCF)

    def _buffer(self, number: int) -> tuple[Frame, int]:
        """Return the frame of a buffer and its second word."""
        at = (_BUFFERS >> 2) + number * _ELEMENT
        identifier, control, low, high = self._ram[at : at + 4]
        is_extended, is_remote = bool(identifier & _XTD), bool(identifier & _RTR)
        can_id = identifier & 0x1FFF_FFFF if is_extended else identifier >> _STDID & 0x7FF
        length = min(control >> 16 & 0xF, 8)
        data = b"" if is_remote else (low | high << 32).to_bytes(8, "little")[:length]
        return Frame(can_id, data, is_remote, is_extended), control

    def _send_next(self) -> None:
        if self._sending is not None or not self._requested or not self.is_on:
            return
        number = self._requested.pop(0)
        if self._values.get(_TXBC, 0) >> 24 & 1:
            self._requested.insert(0, number)
            number = min(self._requested, key=lambda each: (self._buffer(each)[0].can_id, each))
            self._requested.remove(number)
        self._sending = number
        self._wire.send(self._buffer(number)[0], self._sent)

    def _sent(self) -> None:
        number, self._sending = self._sending, None
        if number is None:  # initialised meanwhile
            return
        values = self._values
        values[_TXBTO] = values.get(_TXBTO, 0) | 1 << number
        flags = _TC if values.get(_TXBTIE, 0) >> number & 1 else 0
        if not self._requested:
            flags |= _TFE
        at = (_BUFFERS >> 2) + number * _ELEMENT
        if self._ram[at + 1] >> 23 & 1:
            flags |= self._keep_event(at)
        self._flag(flags)
        self._send_next()

    def _keep_event(self, at: int) -> int:
        if self._events == DEPTH:
            return _TEFL
        put = (_EVENTS >> 2) + (self._event_get + self._events) % DEPTH * 2
        self._ram[put], self._ram[put + 1] = self._ram[at], self._ram[at + 1] & 0xFF0F_0000
        self._events += 1
        return _TEFN | (_TEFF if self._events == DEPTH else 0)

    # From the bus.

    def _receive(self, frame: Frame) -> bool:
        """Take a frame of the bus, where a filter wants it; return False to have it wait."""
        found = self._match(frame) if self.is_on else None
        if found is None:
            return True
        number, index = found
        if self._wire.may_wait and self._counts[number] == DEPTH:
            return False
        if self._counts[number] == DEPTH:
            is_overwritten = self._values.get(_RXGFC, 0) >> 9 - number & 1
            if not is_overwritten:
                self._flag(_LOST << 3 * number)
                return True
            self._gets[number] = (self._gets[number] + 1) % DEPTH
            self._counts[number] -= 1
        put = (self._gets[number] + self._counts[number]) % DEPTH
        at = (_FIFOS[number] >> 2) + put * _ELEMENT
        identifier = frame.can_id | _XTD if frame.is_extended else frame.can_id << _STDID
        self._ram[at] = identifier | (_RTR if frame.is_remote else 0)
        self._ram[at + 1] = len(frame.data) << 16 | index << 24 | self._core.now() // 1000 & 0xFFFF
        data = frame.data.ljust(8, b"\0")
        self._ram[at + 2] = int.from_bytes(data[:4], "little")
        self._ram[at + 3] = int.from_bytes(data[4:], "little")
        self._counts[number] += 1
        full = _FULL if self._counts[number] == DEPTH else 0
        self._flag((_NEW | full) << 3 * number)
        return True

    def _match(self, frame: Frame) -> tuple[int, int] | None:
        """Return the FIFO that takes a frame, and the index of its filter; None for no filter."""
        settings = self._values.get(_RXGFC, 0)
        if frame.is_remote and settings >> (0 if frame.is_extended else 1) & 1:
            return None
        if frame.is_extended:
            action = self._match_extended(frame.can_id, settings >> 24 & 0xF)
            rest = settings >> 2 & 3
        else:
            action = self._match_standard(frame.can_id, settings >> 16 & 0x1F)
            rest = settings >> 4 & 3
        if action is not None:
            to, index = action
            return (_TO_FIFO[to], index) if to in _TO_FIFO else None
        return (rest, 0x80) if rest < len(_FIFOS) else None

    def _match_standard(self, can_id: int, count: int) -> tuple[int, int] | None:
        for index in range(min(count, 28)):
            word = self._ram[(_STANDARD >> 2) + index]
            kind, action = word >> 30, word >> 27 & 7
            first, second = word >> 16 & 0x7FF, word & 0x7FF
            if action and kind != _DISABLED and _fits(kind, can_id, first, second):
                return action, index
        return None

    def _match_extended(self, can_id: int, count: int) -> tuple[int, int] | None:
        for index in range(min(count, 8)):
            at = (_EXTENDED >> 2) + 2 * index
            action, first = self._ram[at] >> 29, self._ram[at] & 0x1FFF_FFFF
            kind, second = self._ram[at + 1] >> 30, self._ram[at + 1] & 0x1FFF_FFFF
            masked = can_id if kind == _DISABLED else can_id & self._values[_XIDAM]
            if action and _fits(0 if kind == _DISABLED else kind, masked, first, second):
                return action, index
        return None

    def _fifo_state(self, number: int) -> int:
        count, get = self._counts[number], self._gets[number]
        full = 1 << 24 if count == DEPTH else 0
        lost = self._values.get(_IR, 0) >> 2 + 3 * number & 1
        return count | get << 8 | (get + count) % DEPTH << 16 | full | lost << 25

    def _release(self, number: int, index: int) -> None:
        released = (index - self._gets[number]) % DEPTH + 1
        self._counts[number] = max(self._counts[number] - released, 0)
        self._gets[number] = (index + 1) % DEPTH
        self._wire.make_room()


def _fits(kind: int, can_id: int, first: int, second: int) -> bool:
    """Return True if a filter wants an identifier: a range, two of them, or a masked one."""
    if kind == 0:
        return first <= can_id <= second
    if kind == 1:
        return can_id in {first, second}
    return not (can_id ^ first) & second
