"""Program download (CiA 302-3): 0x1F50 takes a program, 0x1F51 stops, clears and starts it.

Each sub-index is a program of its own. A download goes into empty memory: the program is stopped
and cleared first. What is downloaded is flashed meanwhile and checked then; 0x1F56 identifies it
and 0x1F57 says what came of it. So do bootloaders of CANopen devices.

The bench runs no program. What stands for one here is that it is there, is valid and is running.
"""

import zlib
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.object_dictionary import ObjectDictionary

DATA: Final = 0x1F50
CONTROL: Final = 0x1F51
IDENTIFICATION: Final = 0x1F56
STATUS: Final = 0x1F57

_CHECKSUM_BYTES: Final = 4
_NUMBERS: Final = range(1, 255)


class Checksum(StrEnum):
    """The way in which a device checks that bytes are a program."""

    NONE = "none"
    """It takes any bytes."""
    CRC32 = "crc32"
    """The last four bytes are the CRC-32 of the others, the lowest byte first."""


class ControlCommand(IntEnum):
    """The control commands of 0x1F51 (CiA 302-3)."""

    STOP = 0
    START = 1
    RESET = 2
    CLEAR = 3


class FlashError(IntEnum):
    """Bits 1 to 7 of 0x1F57 (CiA 302-3)."""

    NONE = 0
    NO_PROGRAM = 1
    FORMAT_UNKNOWN = 2
    CRC = 3
    NOT_CLEARED = 4


@dataclass(frozen=True, slots=True)
class MemoryConfig:
    """The memory of each program of a device.

    Attributes:
        largest: program that it holds [byte].
        checksum: that a program must have.
        write_ns: time that a download is flashed for after its last byte [ns].
    """

    largest: int = 1 << 20
    checksum: Checksum = Checksum.NONE
    write_ns: int = 0


class ProgramMemory:
    """One program of a device, which leaves the factory with a valid one that runs.

    Args:
        object_dictionary: that of the device.
        number: of the program, the sub-index of its objects.
        config: of its memory.
    """

    def __init__(
        self, object_dictionary: ObjectDictionary, number: int, config: MemoryConfig
    ) -> None:
        self._config = config
        self._data = object_dictionary.variable(DATA, number)
        self._control = object_dictionary.variable(CONTROL, number)
        self._shown = object_dictionary.find(IDENTIFICATION, number)
        self._status = object_dictionary.find(STATUS, number)
        self._identification = 0 if self._shown is None else int(self._shown.value)
        self._is_running = self._has_program = True
        self._is_clear = False
        self._error = FlashError.NONE
        self._written: bytes | None = None
        self._ends: int | None = None
        self._data.admit(self._admit)
        self._data.add_check(self._check)
        self._data.add_hook(self._take)
        self._control.add_check(self._check_command)
        self._control.add_hook(self._obey)
        self._show()

    def advance(self, now: int) -> None:
        """Flash up to `now` [ns], and show what came of it, also after a reset of the objects."""
        if self._written is not None:
            if self._ends is None:
                self._ends = now + self._config.write_ns
            if now >= self._ends:
                self._finish(self._written)
        self._show()

    def _admit(self) -> int:
        """Return the most bytes of a download; refuse it where none is allowed now.

        Raises:
            SdoAbort: 0800 0022 while a program runs or is flashed, 0606 0000 where another one has
                not been cleared.
        """
        if self._is_running or self._written is not None:
            raise SdoAbort(*abort_codes.DEVICE_STATE)
        if not self._is_clear:
            self._error = FlashError.NOT_CLEARED
            self._show()
            raise SdoAbort(*abort_codes.HARDWARE)
        return self._config.largest

    def _check(self, data: bytes) -> None:
        """Refuse what does not fit or has a wrong checksum.

        Raises:
            SdoAbort: 0607 0012 for its length, 0606 0000 for its checksum, and as `_admit` says.
        """
        if len(data) > self._admit():
            raise SdoAbort(*abort_codes.LENGTH_TOO_HIGH)
        if not data:
            raise SdoAbort(*abort_codes.LENGTH_TOO_LOW)
        if self._config.checksum is Checksum.CRC32:
            program, checksum = data[:-_CHECKSUM_BYTES], data[-_CHECKSUM_BYTES:]
            if len(program) == 0 or zlib.crc32(program).to_bytes(4, "little") != checksum:
                self._error, self._is_clear = FlashError.CRC, False
                self._show()
                raise SdoAbort(*abort_codes.HARDWARE)

    def _take(self, data: bytes) -> None:
        self._data.value = b""  # nobody reads it, and the memory has it
        self._written, self._ends = data, None
        self._is_clear = False
        self._show()

    def _finish(self, data: bytes) -> None:
        program = data[:-_CHECKSUM_BYTES] if self._config.checksum is Checksum.CRC32 else data
        self._identification = zlib.crc32(program)
        self._has_program = True
        self._written = self._ends = None
        self._error = FlashError.NONE

    def _check_command(self, command: int) -> None:
        """Refuse a command that is none, or none now.

        Raises:
            SdoAbort: 0609 0030, or 0800 0022.
        """
        if command not in frozenset(ControlCommand):
            raise SdoAbort(*abort_codes.VALUE)
        wants_program = command in {ControlCommand.START, ControlCommand.RESET}
        is_clearing = command == ControlCommand.CLEAR
        if (
            self._written is not None
            or (wants_program and not self._has_program)
            or (is_clearing and self._is_running)
        ):
            raise SdoAbort(*abort_codes.DEVICE_STATE)

    def _obey(self, command: int) -> None:
        if command == ControlCommand.CLEAR:
            self._has_program, self._is_clear = False, True
            self._identification, self._error = 0, FlashError.NO_PROGRAM
        else:
            self._is_running = command != ControlCommand.STOP
        self._show()

    def _show(self) -> None:
        self._control.value = int(self._is_running)
        is_busy = self._written is not None
        if self._shown is not None:
            self._shown.value = self._identification
        if self._status is not None:
            self._status.value = self._error << 1 | is_busy


def program_memories(
    object_dictionary: ObjectDictionary, config: MemoryConfig
) -> list[ProgramMemory]:
    """Return the programs of a device: one for each sub-index of its 0x1F50 and 0x1F51."""
    numbers = [entry.subindex for entry in object_dictionary.entries(DATA)]
    return [
        ProgramMemory(object_dictionary, number, config)
        for number in numbers
        if number in _NUMBERS and object_dictionary.find(CONTROL, number) is not None
    ]
