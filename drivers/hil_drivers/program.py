"""Program download (CiA 302-3): a new program into a device, by its objects 0x1F50 to 0x1F57."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from hil_drivers.errors import DriverError, DriverTimeoutError, ProgramError, SdoAbortError
from hil_drivers.network import Network
from hil_drivers.node import Node

DATA, CONTROL, IDENTIFICATION, STATUS = 0x1F50, 0x1F51, 0x1F56, 0x1F57

FLASH_TIME: Final = 60.0
"""Longest time that a device may flash or clear for [s]."""

SLOWEST: Final = 200.0
"""Speed below which a download is given up, on the whole [byte/s]."""

_POLL: Final = 0.05


class ControlCommand(IntEnum):
    """A command to a program (0x1F51)."""

    STOP = 0
    START = 1
    RESET = 2
    CLEAR = 3


FLASH_ERRORS: Final = {
    0: "no error",
    1: "no valid program",
    2: "data format unknown",
    3: "data format or checksum wrong",
    4: "not cleared before the download",
    5: "flash cannot be written",
    6: "address wrong",
    7: "flash is write-protected",
    63: "not specified",
}
"""Bits 1 to 7 of 0x1F57, in words."""


@dataclass(frozen=True, slots=True)
class ProgramState:
    """The state of a program, as the device reports it.

    Attributes:
        is_running: by 0x1F51; None where it does not say.
        identification: 0x1F56; None where it has none.
        status: 0x1F57; None where it has none.
    """

    is_running: bool | None
    identification: int | None
    status: int | None

    @property
    def is_busy(self) -> bool:
        """Return True if the device flashes or clears."""
        return bool(self.status is not None and self.status & 1)

    @property
    def error(self) -> str:
        """The error in 0x1F57 in words; empty without an error."""
        number = 0 if self.status is None or self.is_busy else self.status >> 1 & 0x7F
        return FLASH_ERRORS.get(number, f"error {number}") if number else ""


class ProgramDownload:
    """One program of a device.

    Args:
        network: that the device is on.
        node: the device.
        number: of the program, the sub-index of its objects.
    """

    def __init__(self, network: Network, node: Node, number: int = 1) -> None:
        self._network, self._node, self._number = network, node, number

    def read(self) -> ProgramState:
        """Return the state of the program, read from the device."""
        control = self._read(CONTROL)
        identification, status = self._read(IDENTIFICATION), self._read(STATUS)
        running = None if control is None else control == ControlCommand.START
        return ProgramState(running, identification, status)

    def command(self, command: ControlCommand) -> None:
        """Write to 0x1F51, and wait until the device flashes and clears no more."""
        self._node.download(CONTROL, self._number, bytes([command]))
        self._wait()

    def download(
        self,
        program: bytes,
        *,
        block: bool = True,
        progress: Callable[[int], None] | None = None,
    ) -> None:
        """Write a program to 0x1F50, and wait until it is flashed.

        Args:
            program: of at least one byte.
            block: by block transfer, with a checksum; otherwise in segments.
            progress: told how many bytes have been sent.

        Raises:
            ValueError: the program is empty.
            ProgramError: the device says that it is wrong, or refuses it.
        """
        if not program:
            raise ValueError("an empty program; at least one byte is right")
        client = self._node.sdo
        patience, client.longest_transfer = (
            client.longest_transfer,
            max(client.longest_transfer, len(program) / SLOWEST),
        )
        try:
            self._node.download_stream(DATA, self._number, program, block=block, progress=progress)
        except SdoAbortError as error:
            told = self._error()
            what = f"{error.what}; 0x1F57 says: {told}" if told else error.what
            raise ProgramError(what, device=self._node) from None
        finally:
            client.longest_transfer = patience
        self._wait()
        if told := self._error():
            raise ProgramError(f"the program was refused; 0x1F57 says: {told}", device=self._node)

    def update(
        self,
        program: bytes,
        *,
        block: bool = True,
        start: bool = True,
        progress: Callable[[int], None] | None = None,
    ) -> ProgramState:
        """Stop and clear the old program, download the new one, and start it.

        Args:
            program: as for `download`.
            block: as for `download`.
            start: whether to start it.
            progress: as for `download`.
        """
        self.command(ControlCommand.STOP)
        self.command(ControlCommand.CLEAR)
        self.download(program, block=block, progress=progress)
        if start:
            self.command(ControlCommand.START)
        return self.read()

    def _wait(self) -> None:
        """Wait until the device is no longer busy; it may not answer meanwhile.

        Raises:
            DriverTimeoutError: it still is.
        """
        deadline = self._network.now() + FLASH_TIME
        while True:
            try:
                if not self.read().is_busy:
                    return
            except DriverTimeoutError:
                pass
            if self._network.now() >= deadline:
                what = f"still flashes or does not answer after {FLASH_TIME:g} s"
                raise DriverTimeoutError(what, device=self._node)
            self._network.pump(_POLL)

    def _error(self) -> str:
        try:
            return self.read().error
        except DriverError:
            return ""

    def _read(self, index: int) -> int | None:
        """Return a number of the device; None where it has none."""
        try:
            return int.from_bytes(self._node.upload(index, self._number), "little")
        except SdoAbortError:
            return None
