"""The address claim of a controller (SAE J1939-81)."""

from collections.abc import Callable
from enum import StrEnum
from typing import Final

from hil_drivers.j1939.identifier import NULL
from hil_drivers.j1939.name import BYTES, Name

CONTENTION: Final = 0.25
"""How long others may contend before an address is used [s]."""

_ARBITRARY: Final = range(128, 248)


class ClaimState(StrEnum):
    """The state of an address claim."""

    NONE = "none"
    CLAIMING = "claiming"
    CLAIMED = "claimed"
    LOST = "lost"


class AddressClaim:
    """Claims an address, and defends it.

    Args:
        name: of the controller.
        address: that it wants.
        say: sends the message "address claimed" from an address.

    Attributes:
        state: how far it is.
        address: that it has or wants; `NULL` for none.
    """

    def __init__(self, name: Name, address: int, say: Callable[[int], None]) -> None:
        self.state = ClaimState.NONE
        self.address = address
        self._say = say
        self._number = int.from_bytes(name.pack(), "little")
        self._may_move = bool(name.arbitrary_address)
        self._taken: set[int] = set()
        self._used_from = 0.0

    def begin(self, now: float) -> None:
        """Claim the address at `now` [s]."""
        self.state = ClaimState.CLAIMING
        self._used_from = now + CONTENTION
        self._say(self.address)

    def serve(self, now: float) -> float:
        """Use the address where nobody has contended; return when to be asked next [s]."""
        if self.state is not ClaimState.CLAIMING:
            return float("inf")
        if now < self._used_from:
            return self._used_from
        self.state = ClaimState.CLAIMED
        return float("inf")

    def answer(self) -> None:
        """Answer a request for the address."""
        if self.state is not ClaimState.NONE:
            self._say(self.address)

    def take(self, source: int, data: bytes, now: float) -> bool:
        """Take another one's claim; False where it is malformed."""
        if len(data) != BYTES:
            return False
        self._taken.add(source)
        if self.state in {ClaimState.NONE, ClaimState.LOST} or source != self.address:
            return True
        if self._number < int.from_bytes(data, "little"):
            self._say(self.address)
        else:
            self._yield(now)
        return True

    def _yield(self, now: float) -> None:
        free = next((each for each in _ARBITRARY if each not in self._taken), NULL)
        if self._may_move and free != NULL:
            self.address = free
            self.begin(now)
        else:
            self.state, self.address = ClaimState.LOST, NULL
            self._say(NULL)
