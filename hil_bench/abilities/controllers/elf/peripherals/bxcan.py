"""bxCAN, the CAN controller of STM32F0, F1, F3, F4 and L4 (reference manual RM0090, chapter 32)."""

from collections import deque
from collections.abc import Sequence
from typing import Final

from hil_bench.abilities.controllers.elf.cells import READ, WRITTEN, make_cells
from hil_bench.abilities.controllers.elf.core_view import Core
from hil_bench.abilities.controllers.elf.peripherals.registers import Peripheral
from hil_bench.abilities.controllers.elf.wire import Wire
from hil_bench.canopen_device.frame import Frame

FILTERS_AT: Final = 0x200
BANKS: Final = 28
DEPTH: Final = 3
"""Frames of a receive FIFO."""

_MCR: Final = 0x00
_MSR: Final = 0x04
_TSR: Final = 0x08
_RF0R: Final = 0x0C
_RF1R: Final = 0x10
_IER: Final = 0x14
_BTR: Final = 0x1C
_TX: Final = 0x180
_RX: Final = 0x1B0
_INRQ: Final = 1
_SLEEP: Final = 2
_TXFP: Final = 4
_RFLM: Final = 8
_RESET: Final = 1 << 15
_INAK: Final = 1
_SLAK: Final = 2
_RX_HIGH: Final = 0xC00
_MCR_RESET: Final = 0x0001_0002
_TSR_RESET: Final = 0x1C00_0000
_BTR_RESET: Final = 0x0123_0000
_TXRQ: Final = 1
_RTR: Final = 2
_IDE: Final = 4
_ABRQ: Final = 0x80
_RQCP: Final = 1
_TXOK: Final = 2
_TMEIE: Final = 1
_FMPIE: Final = 2
_FFIE: Final = 4
_FOVIE: Final = 8
_FULL: Final = 8
_FOVR: Final = 16
_RFOM: Final = 32
_LBKM: Final = 1 << 30
_SILM: Final = 1 << 31
_FINIT: Final = 1

_EMPTY: Final = (0, 0, 0, 0)
_KINDS = (
    dict.fromkeys((*range(_MCR, _BTR + 4, 4), *range(_RX, FILTERS_AT, 4)), READ)
    | dict.fromkeys(range(_TX, _RX, 16), READ)
    | {_TX + at: READ | WRITTEN for at in range(48) if at % 16 in {4, 8, 12}}
)


class Filters:
    """The filter banks of a chip.

    Args:
        are_shared: whether CAN1 and CAN2 share them.
    """

    def __init__(self, *, are_shared: bool) -> None:
        self.are_shared = are_shared
        self.reset()

    def reset(self) -> None:
        """Go to the state behind power on: no bank is active."""
        self.control = 0x2A1C_0E01
        self.lists = self.wide = self.fifos = self.active = 0
        self.banks = [[0, 0] for _ in range(BANKS)]
        self._found: dict[tuple[int, bool, bool, bool], tuple[int, int] | None] = {}

    def load(self, offset: int) -> int:
        """Return a register of the banks."""
        if 0x240 <= offset < 0x240 + 8 * BANKS:
            return self.banks[(offset - 0x240) // 8][offset >> 2 & 1]
        name = _FILTER_REGISTERS.get(offset)
        return getattr(self, name) if name else 0

    def store(self, offset: int, value: int) -> None:
        """Write a register of the banks."""
        self._found.clear()
        if 0x240 <= offset < 0x240 + 8 * BANKS:
            self.banks[(offset - 0x240) // 8][offset >> 2 & 1] = value
        elif name := _FILTER_REGISTERS.get(offset):
            setattr(self, name, value)

    def match(self, frame: Frame, *, is_second: bool = False) -> tuple[int, int] | None:
        """Return the FIFO that takes a frame and the index of its filter; None for no filter.

        Args:
            frame: that came.
            is_second: whether it came to the controller that has the banks from CAN2SB on.
        """
        key = frame.can_id, frame.is_extended, frame.is_remote, is_second
        if key not in self._found:
            start = self.control >> 8 & 0x3F if self.are_shared else BANKS
            banks = range(start, BANKS) if is_second else range(start)
            self._found[key] = None if self.control & _FINIT else self._find(frame, banks)
        return self._found[key]

    def _find(self, frame: Frame, banks: range) -> tuple[int, int] | None:
        full = _register(frame)
        short = _short(frame)
        numbers = [0, 0]
        best: tuple[int, int, int, int] | None = None  # width, kind, index, FIFO: least wins
        for bank in banks:
            bit = 1 << bank
            fifo = int(bool(self.fifos & bit))
            is_wide, is_list = bool(self.wide & bit), bool(self.lists & bit)
            count = (2 if is_list else 1) if is_wide else (4 if is_list else 2)
            if self.active & bit:
                place = self._place(self.banks[bank], full, short, is_wide, is_list)
                if place is not None:
                    found = (0 if is_wide else 1, 0 if is_list else 1, numbers[fifo] + place, fifo)
                    best = found if best is None else min(best, found)
            numbers[fifo] += count
        return None if best is None else (best[3], best[2])

    @staticmethod
    def _place(bank: list[int], full: int, short: int, is_wide: bool, is_list: bool) -> int | None:
        first, second = bank
        if is_wide:
            if is_list:
                return next((at for at, each in enumerate(bank) if each & ~1 == full), None)
            return 0 if not (first ^ full) & second & ~1 else None
        halves = (first & 0xFFFF, first >> 16, second & 0xFFFF, second >> 16)
        if is_list:
            return next((at for at, each in enumerate(halves) if each == short), None)
        for at in (0, 1):
            if not (halves[2 * at] ^ short) & halves[2 * at + 1]:
                return at
        return None


_FILTER_REGISTERS = {
    0x200: "control",
    0x204: "lists",
    0x20C: "wide",
    0x214: "fifos",
    0x21C: "active",
}


class BxCan(Peripheral):
    """A controller.

    Args:
        core: that it belongs to.
        wire: the bus that it is on.
        interrupts: of transmission, FIFO 0, FIFO 1 and status, by number.
        filters: that it shares.
        is_second: whether the filters behind CAN2SB are its own.
    """

    def __init__(
        self,
        core: Core,
        wire: Wire,
        interrupts: Sequence[int],
        filters: Filters,
        *,
        is_second: bool = False,
    ) -> None:
        self._core, self._wire, self._interrupts = core, wire, interrupts
        self._filters, self._is_second = filters, is_second
        self.cells = make_cells(FILTERS_AT // 4, _KINDS)
        self._words = self.cells.words
        wire.receive = self._receive
        self.reset()

    def reset(self) -> None:
        """Go to the state behind power on."""
        for place in range(len(self._words)):
            self._words[place] = 0
        self._tsr = self._words[_TSR >> 2] = _TSR_RESET
        self._btr = self._words[_BTR >> 2] = _BTR_RESET
        self._ier = 0
        self._set_mode(_MCR_RESET)
        self._fifos: tuple[deque[tuple[int, int, int, int]], ...] = (deque(), deque())
        self._overruns = [False, False]
        self._waiting: list[int] = []
        self._sending: int | None = None
        if not self._is_second:
            self._filters.reset()

    @property
    def is_on(self) -> bool:
        """Return True while it takes part in the bus."""
        return not self._mcr & (_INRQ | _SLEEP)

    def load(self, offset: int) -> int:
        """Return a register."""
        if offset >= FILTERS_AT:
            return self._filters.load(offset)
        return self._words[offset >> 2]

    def store(self, offset: int, value: int) -> None:
        """Write a register."""
        if offset >= FILTERS_AT:
            self._filters.store(offset, value)
        elif _TX <= offset < _RX:
            self._words[offset >> 2] = value
            if offset & 0xC == 0 and value & _TXRQ:
                self._request(offset - _TX >> 4)
        elif _RF0R <= offset <= _RF1R:
            self._release(offset - _RF0R >> 2, value)
        elif offset == _TSR:
            self._acknowledge(value)
        elif offset == _MCR:
            self._control(value)
        elif offset == _IER:
            self._ier = self._words[_IER >> 2] = value
            self._raise_line()
            self._raise_fifo(0)
            self._raise_fifo(1)
        elif offset == _BTR and self._mcr & _INRQ:
            self._btr = self._words[_BTR >> 2] = value

    def _set_mode(self, value: int) -> None:
        self._mcr = self._words[_MCR >> 2] = value
        state = _INAK if value & _INRQ else _SLAK if value & _SLEEP else 0
        self._words[_MSR >> 2] = _RX_HIGH | state

    def _control(self, value: int) -> None:
        if value & _RESET:
            self.reset()
            return
        self._set_mode(value)
        if self.is_on:
            self._send_next()

    def _request(self, number: int) -> None:
        empty = 1 << 26 + number
        self._tsr &= ~(empty | 0xF << 8 * number)
        self._waiting.append(number)
        self._raise_line()
        self._send_next()

    def _acknowledge(self, value: int) -> None:
        for number in range(3):
            if value >> 8 * number & _RQCP:
                self._tsr &= ~(0xF << 8 * number)
            if value >> 8 * number & _ABRQ and number in self._waiting:
                self._waiting.remove(number)
                self._finish(number, _RQCP)
        self._raise_line()

    def _send_next(self) -> None:
        """Have the bus take the next frame: by identifier, or in order of request."""
        if self._sending is not None or not self._waiting or not self.is_on:
            return
        if self._mcr & _TXFP or len(self._waiting) == 1:
            number = self._waiting[0]
        else:
            number = min(self._waiting, key=lambda each: (self._mailbox(each)[0] & ~1, each))
        self._waiting.remove(number)
        self._sending = number
        frame = _frame(self._mailbox(number))
        if self._btr & (_LBKM | _SILM):
            self._core.alarm(self._core.now() + self._wire.duration(frame), self._sent)
            return
        self._wire.send(frame, self._sent)

    def _sent(self) -> None:
        number, self._sending = self._sending, None
        if number is None:  # reset meanwhile
            return
        if self._btr & _LBKM:
            self._receive(_frame(self._mailbox(number)))
        self._finish(number, _RQCP | _TXOK)
        self._send_next()

    def _mailbox(self, number: int) -> Sequence[int]:
        at = (_TX >> 2) + 4 * number
        return self._words[at : at + 4]

    def _finish(self, number: int, flags: int) -> None:
        self._words[(_TX >> 2) + 4 * number] &= ~_TXRQ
        self._tsr |= 1 << 26 + number | flags << 8 * number
        self._raise_line()

    def _receive(self, frame: Frame) -> bool:
        """Take a frame of the bus, where a filter wants it; return False to have it wait."""
        if not self.is_on:
            return True
        found = self._filters.match(frame, is_second=self._is_second)
        if found is None:
            return True
        number, index = found
        if self._wire.may_wait and len(self._fifos[number]) == DEPTH:
            return False
        data = int.from_bytes(frame.data, "little")
        low, high = data & 0xFFFF_FFFF, data >> 32 & 0xFFFF_FFFF
        entry = (_register(frame), index << 8 | len(frame.data), low, high)
        fifo = self._fifos[number]
        if len(fifo) < DEPTH:
            fifo.append(entry)
        else:
            self._overruns[number] = True
            if not self._mcr & _RFLM:
                fifo[-1] = entry
        self._raise_fifo(number)
        return True

    def _release(self, number: int, value: int) -> None:
        if value & _FOVR:
            self._overruns[number] = False
        if value & _RFOM and self._fifos[number]:
            self._fifos[number].popleft()
            self._wire.make_room()
        self._raise_fifo(number)

    def _raise_line(self) -> None:
        self._words[_TSR >> 2] = self._tsr
        is_done = bool(self._tsr & 0x010101) and bool(self._ier & _TMEIE)
        self._core.hold_line(self._interrupts[0], is_active=is_done)

    def _raise_fifo(self, number: int) -> None:
        enabled = self._ier >> 3 * number
        words, fifo = self._words, self._fifos[number]
        count = len(fifo)
        full = _FULL if count == DEPTH else 0
        words[(_RF0R >> 2) + number] = count | full | (_FOVR if self._overruns[number] else 0)
        at = (_RX >> 2) + 4 * number
        words[at], words[at + 1], words[at + 2], words[at + 3] = fifo[0] if fifo else _EMPTY
        is_due = (
            (count and enabled & _FMPIE)
            or (count == DEPTH and enabled & _FFIE)
            or (self._overruns[number] and enabled & _FOVIE)
        )
        self._core.hold_line(self._interrupts[1 + number], is_active=bool(is_due))


def _register(frame: Frame) -> int:
    """Return the identifier of a frame as RIxR and wide filters have it."""
    remote = _RTR if frame.is_remote else 0
    if frame.is_extended:
        return frame.can_id << 3 | _IDE | remote
    return frame.can_id << 21 | remote


def _short(frame: Frame) -> int:
    """Return the identifier of a frame as narrow filters have it."""
    remote = 0x10 if frame.is_remote else 0
    if frame.is_extended:
        return frame.can_id >> 18 << 5 | remote | 8 | frame.can_id >> 15 & 7
    return frame.can_id << 5 | remote


def _frame(mailbox: Sequence[int]) -> Frame:
    identifier, length, low, high = mailbox
    is_extended, is_remote = bool(identifier & _IDE), bool(identifier & _RTR)
    data = (low | high << 32).to_bytes(8, "little")[: min(length & 0xF, 8)]
    can_id = identifier >> (3 if is_extended else 21)
    return Frame(can_id, b"" if is_remote else data, is_remote, is_extended)
