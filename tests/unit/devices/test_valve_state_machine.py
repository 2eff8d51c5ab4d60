"""The CiA 408 state machine against tables written by hand.

Source of the tables: Moog ACV CANopen manual B99224-DV018-D-211, section 5.2: states and their
status bits (figure 19), words of TR2 to TR7 (M H D = xx1, x11, 111, 0xx, 00x, 000), fault states
by origin (page 48), "every transition between the actual state and the requested state will be
processed". What it leaves open: decision 0003.
"""

import pytest

from hil_bench.devices.valve_state_machine import (
    FAULT_STATES,
    STATUS_BITS,
    TRANSITIONS,
    ValveState,
    ValveStateMachine,
    walk,
)

LETTERS = {
    "N": ValveState.NOT_READY,
    "I": ValveState.INIT,
    "D": ValveState.DISABLED,
    "H": ValveState.HOLD,
    "A": ValveState.ACTIVE,
    "R": ValveState.FAULT_REACTION,
    "h": ValveState.FAULT_HOLD,
    "d": ValveState.FAULT_DISABLED,
    "i": ValveState.FAULT_INIT,
}

# The states passed, by the state before the word; the columns are MHD = 000, 001, ... 111.
WITHOUT_RESET = {
    "N": ("", "", "", "", "", "", "", ""),
    "I": ("", "D", "", "DH", "", "D", "", "DHA"),
    "D": ("I", "", "", "H", "", "", "", "HA"),
    "H": ("DI", "D", "", "", "", "", "", "A"),
    "A": ("HDI", "HD", "H", "H", "", "", "", ""),
    "R": ("", "", "", "", "", "", "", ""),
    "h": ("di", "d", "", "", "", "", "", ""),
    "d": ("i", "", "", "", "", "", "", ""),
    "i": ("", "", "", "", "", "", "", ""),
}

# The same with a rising edge of R: only the fault states know it, and none reaches ACTIVE.
WITH_RESET = {
    **{letter: WITHOUT_RESET[letter] for letter in "NIDHAR"},
    "h": ("HDI", "HD", "H", "H", "H", "H", "H", "H"),
    "d": ("DI", "D", "D", "DH", "D", "D", "D", "DH"),
    "i": ("I", "ID", "I", "IDH", "I", "ID", "I", "IDH"),
}


def states(letters):
    return tuple(LETTERS[letter] for letter in letters)


def letters(states):
    names = {state: letter for letter, state in LETTERS.items()}
    return "".join(names[state] for state in states)


def in_state(letter):
    machine = ValveStateMachine()
    machine.state = LETTERS[letter]
    return machine


def table(*, bits=0, **options):
    """The states that `walk` passes, laid out as above."""
    return {
        letter: tuple(letters(walk(state, word | bits, **options)) for word in range(8))
        for letter, state in LETTERS.items()
    }


def test_each_state_obeys_each_word():
    assert table(reset=False, may_activate=True) == WITHOUT_RESET


def test_each_state_obeys_each_word_with_a_reset():
    assert table(bits=0x8, reset=True, may_activate=True) == WITH_RESET


def test_where_active_is_barred_the_walk_ends_before_it():
    assert table(reset=False, may_activate=False) == {
        letter: tuple(passed.replace("A", "") for passed in row)
        for letter, row in WITHOUT_RESET.items()
    }


@pytest.mark.parametrize("upper_bits", [0x0010, 0x0100, 0x8000, 0xFFF0])
def test_bits_4_to_15_do_not_count(upper_bits):
    assert table(bits=upper_bits, reset=False, may_activate=True) == WITHOUT_RESET


def test_status_bits_are_those_of_the_manual():
    # Figure 19, <StatusWord> RMHD.
    assert {letter: f"{STATUS_BITS[state]:04b}" for letter, state in LETTERS.items()} == {
        "N": "0000",
        "I": "1000",
        "D": "1001",
        "H": "1011",
        "A": "1111",
        "R": "0111",
        "h": "0011",
        "d": "0001",
        "i": "0000",
    }


def test_the_ready_bit_is_missing_in_each_fault_state():
    assert states("Rhdi") == tuple(sorted(FAULT_STATES, key=list(LETTERS.values()).index))
    assert not any(STATUS_BITS[state] & 0x8 for state in FAULT_STATES)


def test_each_transition_has_a_number_of_its_own():
    assert sorted(int(transition.name[2:]) for transition in TRANSITIONS) == [
        *(2, 3, 4, 5, 6, 7, 10, 11, 14, 15, 16)
    ]


def test_a_machine_starts_in_not_ready_and_then_is_in_init():
    machine = ValveStateMachine()
    assert machine.state is ValveState.NOT_READY
    machine.start()
    assert machine.state is ValveState.INIT


def obey(machine, word, *, may_activate=True, may_reset=True):
    return machine.receive(word, may_activate=may_activate, may_reset=may_reset)


def test_the_reset_bit_acts_on_its_rising_edge_only():
    machine = in_state("A")
    obey(machine, 0x000F)
    machine.fault()
    assert obey(machine, 0x000F) == ()
    assert obey(machine, 0x0007) == ()
    assert obey(machine, 0x000F) == states("H")


def test_the_word_after_a_reset_may_lead_to_active():
    machine = in_state("h")
    obey(machine, 0x000F)
    assert machine.state is ValveState.HOLD
    assert obey(machine, 0x000F) == states("A")


def test_a_refused_reset_needs_another_edge():
    machine = in_state("h")
    assert obey(machine, 0x000F, may_reset=False) == ()
    assert obey(machine, 0x000F) == ()
    obey(machine, 0x0007)
    assert obey(machine, 0x000F) == states("H")


def test_a_start_forgets_the_reset_bit():
    machine = in_state("A")
    obey(machine, 0x000F)
    machine.start()
    machine.fault()
    assert obey(machine, 0x0008) == states("I")


def assert_passes(act, passed):
    """A machine in each state passes these when it acts, and ends in the last of them."""
    machines = {letter: in_state(letter) for letter in LETTERS}
    found = {letter: letters(act(machine)) for letter, machine in machines.items()}
    assert found == dict.fromkeys(LETTERS, "") | passed
    ends = letters(machine.state for machine in machines.values())
    assert ends == "".join((letter + found[letter])[-1] for letter in LETTERS)


def test_a_fault_passes_the_fault_reaction():
    # Page 48, "coming from"; the reaction "hold" never raises the state.
    reactions = {"I": "Ri", "D": "Rd", "H": "Rh", "A": "Rh", "h": "Rh", "d": "Rd", "i": "Ri"}
    assert_passes(ValveStateMachine.fault, reactions)


def test_deactivation_leaves_active_and_nothing_else():
    assert_passes(ValveStateMachine.deactivate, {"A": "H"})


def test_without_the_enable_input_no_state_above_disabled_stays():
    assert_passes(ValveStateMachine.disable, {"A": "HD", "H": "D", "h": "d"})


def test_without_the_enable_input_no_control_word_leads_above_disabled():
    found = table(bits=0x8, reset=True, may_activate=True, is_enabled=False)
    assert not {"H", "A"} & {*"".join(found[letter][7] for letter in LETTERS if letter not in "AH")}


def test_without_the_enable_input_a_valve_may_still_be_initialised():
    passed = walk(ValveState.INIT, 0x0007, reset=False, may_activate=True, is_enabled=False)
    assert passed == states("D")


@pytest.mark.parametrize(
    ("letter", "after"),
    [("I", "i"), ("D", "d"), ("H", "h"), ("A", "h"), ("h", "h"), ("d", "d"), ("i", "i")],
)
def test_a_reaction_that_takes_time_lasts_until_its_end(letter, after):
    machine = in_state(letter)
    assert machine.fault(takes_time=True) == states("R")
    assert machine.fault(takes_time=True) == ()  # another fault changes nothing
    assert machine.end_reaction() == states(after)
    assert machine.end_reaction() == ()


@pytest.mark.parametrize(
    ("word", "after"),
    # As TR15 and TR16 say; nothing raises the state, and the edge of R is lost.
    [(0x0007, "h"), (0x000F, "h"), (0x0003, "h"), (0x0001, "hd"), (0x0000, "hdi")],
)
def test_a_word_in_the_reaction_may_lower_the_state_that_follows(word, after):
    machine = in_state("A")
    machine.fault(takes_time=True)
    assert obey(machine, word) == ()
    assert machine.state is ValveState.FAULT_REACTION
    assert machine.end_reaction() == states(after)


def test_the_last_word_in_the_reaction_counts_and_none_from_before():
    machine = in_state("A")
    obey(machine, 0x0007)
    machine.fault(takes_time=True)
    obey(machine, 0x0000)
    obey(machine, 0x0003)
    assert machine.end_reaction() == states("h")
    machine.fault(takes_time=True)
    assert machine.end_reaction() == states("h")
