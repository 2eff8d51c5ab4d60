"""Address claim by SAE J1939-81: claim, contention, cannot claim, request, commanded address."""

from collections.abc import Callable
from enum import StrEnum
from typing import Final

from hil_bench.abilities.j1939.protocol.signals import NAME_BYTES, NULL, Name
from hil_bench.canopen_device.agenda import MILLISECOND, NEVER

CONTENTION: Final = 250 * MILLISECOND
"""How long a device waits for others to contend before it uses an address [ns]."""

_SLOT: Final = 600_000
"""Unit of the delay before a device says that it cannot claim [ns]; 0 to 255 of them."""

_AT_ONCE: Final = (range(128), range(248, NULL))
"""Addresses that belong to a function: used without waiting for contention."""

_ARBITRARY: Final = range(128, 248)
"""Addresses that a device may take by itself."""

Claim = Callable[[int], None]
"""Sends the address-claimed message, from the address that it is given."""


class ClaimState(StrEnum):
    """The state of a device's address claim."""

    OFF = "off"
    CLAIMING = "claiming"
    CLAIMED = "claimed"
    CANNOT = "cannot claim"


class AddressClaim:
    """The claim of one device.

    Args:
        name: of the device.
        preferred: the address that it claims first.
        claim: sends its claims.

    Attributes:
        state: how far it is.
        address: the address that it has or claims; `NULL` for none.
        due: when `serve` has something to do [ns].
    """

    def __init__(self, name: Name, preferred: int, claim: Claim) -> None:
        self.state = ClaimState.OFF
        self.address = NULL
        self.due = NEVER
        self._preferred, self._claim = preferred, claim
        self._name = int(name)
        self._may_move = name.arbitrary_address
        self._taken: set[int] = set()

    def start(self, now: int) -> None:
        """Claim the preferred address at `now` [ns]."""
        self._taken.clear()
        self._begin(self._preferred, now)

    def resume(self, now: int) -> None:
        """Claim the last address again at `now` [ns], or the preferred one where there is none."""
        if self.state is not ClaimState.OFF:
            self._begin(self._preferred if self.address == NULL else self.address, now)

    def stop(self) -> None:
        """Have no address any more, and say nothing."""
        self.state, self.address, self.due = ClaimState.OFF, NULL, NEVER

    def take(self, source: int, data: bytes, now: int) -> None:
        """Take the claim of another device."""
        if len(data) != NAME_BYTES or self.state is ClaimState.OFF:
            return
        if source in _ARBITRARY:
            self._taken.add(source)
        if source != self.address or source == NULL:
            return
        if self._name < int.from_bytes(data, "little"):
            self._claim(self.address)
        else:
            self._yield(now)

    def answer(self, now: int) -> None:
        """Answer a request for the address claimed."""
        if self.state is ClaimState.CANNOT:
            self.due = min(self.due, now + self._delay())
        elif self.state is not ClaimState.OFF:
            self._claim(self.address)

    def command(self, data: bytes, now: int) -> None:
        """Obey a commanded address: eight bytes NAME, one byte address."""
        is_meant = int.from_bytes(data[:NAME_BYTES], "little") == self._name
        if self.state is not ClaimState.OFF and len(data) == NAME_BYTES + 1 and is_meant:
            address = data[NAME_BYTES]
            if address < NULL:
                self._begin(address, now)

    def serve(self, now: int) -> None:
        """Do what is due at `now` [ns]."""
        if now < self.due:
            return
        self.due = NEVER
        if self.state is ClaimState.CLAIMING:
            self.state = ClaimState.CLAIMED
        elif self.state is ClaimState.CANNOT:
            self._claim(NULL)

    def _begin(self, address: int, now: int) -> None:
        self.address = address
        self._claim(address)
        if any(address in addresses for addresses in _AT_ONCE):
            self.state, self.due = ClaimState.CLAIMED, NEVER
        else:
            self.state, self.due = ClaimState.CLAIMING, now + CONTENTION

    def _yield(self, now: int) -> None:
        """Leave the address to a device of a smaller or the same NAME."""
        self._taken.add(self.address)
        free = next((each for each in _ARBITRARY if each not in self._taken), None)
        if self._may_move and free is not None:
            self._begin(free, now)
            return
        self.state, self.address = ClaimState.CANNOT, NULL
        self.due = now + self._delay()

    def _delay(self) -> int:
        """Return the pseudo-random delay that keeps devices without address apart [ns]."""
        return (sum(self._name.to_bytes(NAME_BYTES, "little")) & 0xFF) * _SLOT
