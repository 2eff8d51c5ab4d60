"""The twin's valve: it obeys what it hears, and is corrected by what the machine's valve says."""

import math
from collections.abc import Mapping
from functools import partial
from types import MappingProxyType
from typing import Final

from hil_bench.abilities.shadow.node_states import GRACE
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.devices.position_control import POSITION
from hil_bench.devices.pressure_control import PRESSURE, PRESSURE_AND_FLOW
from hil_bench.devices.valve_408 import LOCAL_BIT, SPOOL, ValveDevice
from hil_bench.devices.valve_state_machine import FAULT_STATES, STATUS_BITS, ValveState

_STATE_BITS = 0b1111
_STATES = {bits: state for state, bits in STATUS_BITS.items()}
"""By the status word's bits; 0 is NOT_READY too, which the valve leaves by itself."""
_NS = 1e-9

_SPOOL_SETPOINT, _PRESSURE_SETPOINT, _AXIS_SETPOINT = (0x6300, 1), (0x6380, 1), (0x6600, 1)
_SETPOINTS: Final[Mapping[int, tuple[tuple[int, int], ...]]] = MappingProxyType(
    {
        SPOOL: (_SPOOL_SETPOINT,),
        PRESSURE: (_PRESSURE_SETPOINT,),
        PRESSURE_AND_FLOW: (_SPOOL_SETPOINT, _PRESSURE_SETPOINT),
        POSITION: (_AXIS_SETPOINT,),
    }
)
"""What commands the valve, by its control mode."""
_AT_ITS_END: Final = 0.95


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
        self._heard: set[tuple[int, int]] = set()
        self._device = device
        self._state = device.state
        self._changed_at = -math.inf
        self._held: ValveState | None = None
        self._held_word = 0
        objects = device.node.object_dictionary
        self._word = objects.variable(0x6040)
        self._mode = objects.find(0x6043)
        for place in {place for places in _SETPOINTS.values() for place in places}:
            if (setpoint := objects.find(*place)) is not None:
                setpoint.add_hook(partial(self._hear_setpoint, place))

    @property
    def obstacle(self) -> str:
        """Why the bus does not show the set-point of an ACTIVE valve; empty where it does."""
        if self.is_local:
            return "not on the bus: the valve is under local control"
        mode = SPOOL if self._mode is None else self._mode.value
        lacking = [place for place in _SETPOINTS.get(mode, ()) if place not in self._heard]
        if not lacking:
            return ""
        which = "" if mode == SPOOL else f" in control mode {mode}"
        return f"not heard, and the valve is ACTIVE{which}"

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

    def can_shift(self, spool: float) -> bool:
        """Return True if the machine's spool says where its axis' controller has come to.

        At its end it says nothing of an integral behind it.

        Args:
            spool: where it is, as fraction of full opening.
        """
        return abs(spool) < _AT_ITS_END or not self._device.position_control.has_integral

    def shift(self, spool: float, position: float) -> None:
        """Have a ramp and the axis' controller of the valve go on from elsewhere.

        Args:
            spool: by how much the spool is elsewhere, as fraction of full opening.
            position: by how much the axis is [m].
        """
        self._device.shift(spool, position)

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

    def _hear_setpoint(self, place: tuple[int, int], _increments: int) -> None:
        self._heard.add(place)
