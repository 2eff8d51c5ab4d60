"""The device state machine of CiA 408, driven by the control word 0x6040.

The control word carries D (bit 0), H (bit 1), M (bit 2) and R (bit 3); its other bits are not
looked at. The status word 0x6041 shows the state in the same four bits, R meaning "ready":

    state            R M H D   reached by
    NOT_READY        0 0 0 0   TR0   power-on
    INIT             1 0 0 0   TR1   the device has started
                               TR7   from DISABLED, MHD = 000
                               TR14  from FAULT_INIT, reset
    DISABLED         1 0 0 1   TR2   from INIT, D = 1
                               TR6   from HOLD, MH = 00
                               TR10  from FAULT_DISABLED, reset
    HOLD             1 0 1 1   TR3   from DISABLED, HD = 11
                               TR5   from ACTIVE, M = 0
                               TR11  from FAULT_HOLD, reset
    ACTIVE           1 1 1 1   TR4   from HOLD, MHD = 111
    FAULT_REACTION   0 1 1 1   TR8   a fault, from any state but NOT_READY
    FAULT_HOLD       0 0 1 1   TR9   from FAULT_REACTION, entered from HOLD, ACTIVE or FAULT_HOLD
    FAULT_DISABLED   0 0 0 1   TR12  from FAULT_REACTION, entered from DISABLED or FAULT_DISABLED
                               TR15  from FAULT_HOLD, MH = 00
    FAULT_INIT       0 0 0 0   TR13  from FAULT_REACTION, entered from INIT or FAULT_INIT
                               TR16  from FAULT_DISABLED, MHD = 000

Rules:

1. A control word is looked at once, when it is received. A word that only still stands in 0x6040
   does nothing.
2. One control word walks as far as it can, and every state in between is passed.
3. A reset is the rising edge of R from one control word to the next. The word that resets a fault
   does not lead to ACTIVE; the next word may.
4. Without the enable input ACTIVE, HOLD and FAULT_HOLD are left at once, and not entered. When
   the input is back, a new control word is needed.
5. The fault reaction is to go to the hold set-point. Where that takes time, on a ramp,
   FAULT_REACTION lasts as long, and nothing is reset; the last control word that comes meanwhile
   may lower the fault state that follows. Otherwise it is passed at once. A fault never raises the
   state.

Source: Moog ACV CANopen manual B99224-DV018-D-211, section 5.2 (states, words, transitions and
rule 2). Rules 1, 3 (second sentence), 4 and 5 are this device's own, as are the words of TR15 and
TR16 and which of TR12 and TR13 is which; see decision 0003.
"""

from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import Final, NamedTuple

RESET_BIT: Final = 0b1000
"""R of the control word."""


class ValveState(StrEnum):
    """The states of the device state machine."""

    NOT_READY = "NOT_READY"
    INIT = "INIT"
    DISABLED = "DISABLED"
    HOLD = "HOLD"
    ACTIVE = "ACTIVE"
    FAULT_REACTION = "FAULT_REACTION"
    FAULT_HOLD = "FAULT_HOLD"
    FAULT_DISABLED = "FAULT_DISABLED"
    FAULT_INIT = "FAULT_INIT"


STATUS_BITS: Final = MappingProxyType(
    {
        ValveState.NOT_READY: 0b0000,
        ValveState.INIT: 0b1000,
        ValveState.DISABLED: 0b1001,
        ValveState.HOLD: 0b1011,
        ValveState.ACTIVE: 0b1111,
        ValveState.FAULT_REACTION: 0b0111,
        ValveState.FAULT_HOLD: 0b0011,
        ValveState.FAULT_DISABLED: 0b0001,
        ValveState.FAULT_INIT: 0b0000,
    }
)
"""Bits 3 to 0 (R, M, H, D) of the status word in each state."""

FAULT_STATES: Final = frozenset(
    {
        ValveState.FAULT_REACTION,
        ValveState.FAULT_HOLD,
        ValveState.FAULT_DISABLED,
        ValveState.FAULT_INIT,
    }
)


class Transition(NamedTuple):
    """A transition that a control word causes: taken where `word & mask == value`.

    Attributes:
        name: the profile's number.
        source: the state it leaves.
        target: the state it enters.
        mask: the bits of the control word that count.
        value: what those bits must be.
        is_reset: it needs a rising edge of R as well.
    """

    name: str
    source: ValveState
    target: ValveState
    mask: int
    value: int
    is_reset: bool = False


_D: Final = 0b001
_HD: Final = 0b011
_M: Final = 0b100
_MH: Final = 0b110
_MHD: Final = 0b111

TRANSITIONS: Final = (
    Transition("TR2", ValveState.INIT, ValveState.DISABLED, _D, _D),
    Transition("TR3", ValveState.DISABLED, ValveState.HOLD, _HD, _HD),
    Transition("TR4", ValveState.HOLD, ValveState.ACTIVE, _MHD, _MHD),
    Transition("TR5", ValveState.ACTIVE, ValveState.HOLD, _M, 0),
    Transition("TR6", ValveState.HOLD, ValveState.DISABLED, _MH, 0),
    Transition("TR7", ValveState.DISABLED, ValveState.INIT, _MHD, 0),
    Transition("TR10", ValveState.FAULT_DISABLED, ValveState.DISABLED, 0, 0, is_reset=True),
    Transition("TR11", ValveState.FAULT_HOLD, ValveState.HOLD, 0, 0, is_reset=True),
    Transition("TR14", ValveState.FAULT_INIT, ValveState.INIT, 0, 0, is_reset=True),
    Transition("TR15", ValveState.FAULT_HOLD, ValveState.FAULT_DISABLED, _MH, 0),
    Transition("TR16", ValveState.FAULT_DISABLED, ValveState.FAULT_INIT, _MHD, 0),
)
"""The transitions of the control word; from one state, a reset is tried before the others."""

_LEAVING: Final = MappingProxyType(
    {
        state: tuple(transition for transition in TRANSITIONS if transition.source is state)
        for state in ValveState
    }
)

FAULT_TARGETS: Final = MappingProxyType(
    {
        ValveState.INIT: ValveState.FAULT_INIT,
        ValveState.DISABLED: ValveState.FAULT_DISABLED,
        ValveState.HOLD: ValveState.FAULT_HOLD,
        ValveState.ACTIVE: ValveState.FAULT_HOLD,
        ValveState.FAULT_HOLD: ValveState.FAULT_HOLD,
        ValveState.FAULT_DISABLED: ValveState.FAULT_DISABLED,
        ValveState.FAULT_INIT: ValveState.FAULT_INIT,
    }
)
"""Where a fault leads through FAULT_REACTION (TR8, then TR9, TR12 or TR13)."""


DISABLED_BY_INPUT: Final = MappingProxyType(
    {
        ValveState.ACTIVE: (ValveState.HOLD, ValveState.DISABLED),
        ValveState.HOLD: (ValveState.DISABLED,),
        ValveState.FAULT_HOLD: (ValveState.FAULT_DISABLED,),
    }
)
"""The states that a valve passes when its enable input goes off; in the others it stays."""

_ENABLED_STATES: Final = frozenset({ValveState.HOLD, ValveState.ACTIVE})


def next_transition(state: ValveState, control_word: int, *, reset: bool) -> Transition | None:
    """Return the transition that a control word causes in a state, or None where it stays.

    Args:
        state: the present state.
        control_word: value of 0x6040.
        reset: whether this word brought a rising edge of R that counts.
    """
    for transition in _LEAVING[state]:
        _, _, _, mask, value, is_reset = transition
        if control_word & mask == value and (reset or not is_reset):
            return transition
    return None


def walk(
    state: ValveState,
    control_word: int,
    *,
    reset: bool,
    may_activate: bool,
    is_enabled: bool = True,
) -> tuple[ValveState, ...]:
    """Return the states that one control word passes, in order, without the one it starts in.

    Args:
        state: the state when the word arrives.
        control_word: value of 0x6040.
        reset: whether this word brought a rising edge of R that counts.
        may_activate: whether ACTIVE may be entered; a reset on the way bars it too.
        is_enabled: whether the enable input is on; otherwise HOLD is barred as well.
    """
    passed: list[ValveState] = []
    while transition := next_transition(state, control_word, reset=reset):
        may_activate = may_activate and not transition.is_reset
        if transition.target is ValveState.ACTIVE and not may_activate:
            break
        if transition.target in _ENABLED_STATES and not is_enabled:
            break
        state = transition.target
        passed.append(state)
    return tuple(passed)


class ValveStateMachine:
    """The state of one valve, and the last control word, which the rising edge of R needs.

    Attributes:
        state: the present state; NOT_READY until `start`.
    """

    def __init__(self) -> None:
        self.state = ValveState.NOT_READY
        self._is_reset_bit_set = False
        self._after_reaction = ValveState.NOT_READY
        self._word_in_reaction: int | None = None

    def start(self) -> None:
        """Start, or start again: NOT_READY (TR0), then INIT (TR1)."""
        self.state = ValveState.INIT
        self._is_reset_bit_set = False

    def receive(
        self, control_word: int, *, may_activate: bool, may_reset: bool, is_enabled: bool = True
    ) -> tuple[ValveState, ...]:
        """Obey a control word that has just arrived and return the states passed.

        Args:
            control_word: value of 0x6040.
            may_activate: whether ACTIVE may be entered now.
            may_reset: whether a fault may be reset now, its cause being gone.
            is_enabled: whether the enable input is on.
        """
        is_reset_bit_set = bool(control_word & RESET_BIT)
        reset = may_reset and is_reset_bit_set and not self._is_reset_bit_set
        self._is_reset_bit_set = is_reset_bit_set
        if self.state is ValveState.FAULT_REACTION:
            self._word_in_reaction = control_word
        if next_transition(self.state, control_word, reset=reset) is None:
            return ()
        states = walk(
            self.state, control_word, reset=reset, may_activate=may_activate, is_enabled=is_enabled
        )
        return self._pass(states)

    def fault(self, *, takes_time: bool = False) -> tuple[ValveState, ...]:
        """React to a fault and return the states passed; none before `start` or in a reaction.

        Args:
            takes_time: whether FAULT_REACTION lasts until `end_reaction`.
        """
        target = FAULT_TARGETS.get(self.state)
        if target is None:
            return ()
        self._after_reaction, self._word_in_reaction = target, None
        passed = self._pass((ValveState.FAULT_REACTION,))
        return passed if takes_time else passed + self.end_reaction()

    def end_reaction(self) -> tuple[ValveState, ...]:
        """Leave FAULT_REACTION (TR9, TR12 or TR13), and return the states passed."""
        if self.state is not ValveState.FAULT_REACTION:
            return ()
        states: tuple[ValveState, ...] = (self._after_reaction,)
        if self._word_in_reaction is not None:
            states += walk(states[0], self._word_in_reaction, reset=False, may_activate=False)
        return self._pass(states)

    def adopt(self, state: ValveState) -> None:
        """Enter the state that another valve reports, whatever led it there."""
        if state is ValveState.FAULT_REACTION:
            self.fault(takes_time=True)
        else:
            self.state = state

    def deactivate(self) -> tuple[ValveState, ...]:
        """Leave ACTIVE for HOLD (TR5), without a control word, and return the states passed."""
        if self.state is not ValveState.ACTIVE:
            return ()
        return self._pass((ValveState.HOLD,))

    def disable(self) -> tuple[ValveState, ...]:
        """Leave ACTIVE and HOLD for DISABLED (TR5, TR6, TR15), and return the states passed."""
        return self._pass(DISABLED_BY_INPUT.get(self.state, ()))

    def _pass(self, states: tuple[ValveState, ...]) -> tuple[ValveState, ...]:
        if states:
            self.state = states[-1]
        return states


# Commands of a valve in place of CANopen while 0x604F (local) is 1.
#
# It stands for the panel that a CiA 408 device may have; here a second bus, such as Modbus, is at
# it. While it rules, an NMT state other than OPERATIONAL does not hold the valve, and 0x6040 and
# 0x6300.01 are not looked at.
#
# Its set-point is watched as that of an RPDO: where no command came for the time of the watchdog,
# an ACTIVE valve has a fault. Time 0 switches that off. In every other state silence is harmless.


@dataclass(slots=True)
class LocalCommand:
    """The local control word and set-point, and when they came.

    Attributes:
        control_word: the last one.
        setpoint: spool set-point [increments].
        watchdog: longest time between two commands [ns]; 0 for any.
        received_at: when the last command came [ns].
    """

    control_word: int = 0
    setpoint: int = 0
    watchdog: int = 1_000_000_000
    received_at: int = 0

    def restart(self) -> None:
        """Forget what was commanded; the watchdog keeps its time."""
        self.control_word = 0
        self.setpoint = 0

    def is_late(self, now: int) -> bool:
        """Return True if the next command should have come by `now` [ns]."""
        return bool(self.watchdog) and now - self.received_at > self.watchdog
