"""The twin's valve: it obeys what it hears, and is corrected by what the machine's valve says."""

import math

from hil_bench.canopen_device.nmt import NmtState
from hil_bench.devices.valve_408 import LOCAL_BIT, ValveDevice
from hil_bench.devices.valve_state_machine import FAULT_STATES, STATUS_BITS, ValveState
from hil_bench.machine.shadow.node_states import GRACE

_STATE_BITS = 0b1111
_STATES = {bits: state for state, bits in STATUS_BITS.items()}
"""By the status word's bits; 0 is NOT_READY too, which the valve leaves by itself."""
_NS = 1e-9


class FollowedValve:
    """The valve of a twin in place of its `ValveDevice`.

    The device takes control words and set-points from the bus and so acts when the machine's does.
    What the bus does not show is why the machine's may be in another state: a command from before
    we listened, an enable input, a fault. Then its status word counts, and the control word that
    stands is known not to lead out of that state.

    Args:
        device: the twin's valve.

    Attributes:
        full_opening: as of the device [m].
        reported: the state that the machine's valve says it is in; None before it has.
        is_local: whether the machine's valve says that its local command rules.
    """

    def __init__(self, device: ValveDevice) -> None:
        self.full_opening = device.full_opening
        self.reported: ValveState | None = None
        self.is_local = False
        self._is_commanded = False
        self._device = device
        self._state = device.state
        self._changed_at = -math.inf
        self._held: ValveState | None = None
        self._held_word = 0
        objects = device.node.object_dictionary
        self._word = objects.variable(0x6040)
        objects.variable(0x6300, 1).add_hook(self._hear_setpoint)

    @property
    def obstacle(self) -> str:
        """Why the bus does not show the set-point of an ACTIVE valve; empty where it does."""
        if self.is_local:
            return "not on the bus: the valve is under local control"
        return "" if self._is_commanded else "not heard, and the valve is ACTIVE"

    @property
    def state(self) -> ValveState:
        """State of the twin's valve."""
        return self._device.state

    def command(self, now: int) -> float:
        """Return the spool set-point [m] at `now` [ns]."""
        if self._held is not None:
            self._hold(self._held)
        setpoint = self._device.command(now)
        if self._device.state is not self._state:
            self._state = self._device.state
            self._changed_at = now * _NS
        return setpoint

    def publish(self, spool_position: float, now: int) -> None:
        """Take the spool position [m] at `now` [ns]."""
        self._device.publish(spool_position, now)

    def shift_ramp(self, offset: float) -> None:
        """Have a ramp of the valve go on from elsewhere; as fraction of full opening."""
        self._device.shift_ramp(offset)

    def hear(self, status_word: int, time: float) -> bool:
        """Take the machine's status word, and return whether the twin had to be corrected.

        Args:
            status_word: of the machine's valve.
            time: when the word was taken, at the earliest [s].
        """
        bits = status_word & _STATE_BITS
        self.is_local = bool(status_word & LOCAL_BIT)
        self.reported = _STATES.get(bits)
        if self.reported is None or bits == STATUS_BITS[self.state]:
            return False
        if time - self._changed_at < GRACE:
            return False
        self._held, self._held_word = self.reported, self._word.value
        self._adopt(self.reported)
        return True

    def _hold(self, held: ValveState) -> None:
        """Stay in a state until something new is heard that may lead out of it."""
        is_new = self._word.value != self._held_word
        has_failed = self.state in FAULT_STATES and held not in FAULT_STATES
        if is_new or has_failed or self._device.node.state is not NmtState.OPERATIONAL:
            self._held = None
        elif self.state is not held:
            self._adopt(held)

    def _adopt(self, state: ValveState) -> None:
        self._device.adopt(state)
        self._state = self._device.state

    def _hear_setpoint(self, _increments: int) -> None:
        self._is_commanded = True
