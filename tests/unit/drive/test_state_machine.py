"""Transitions of CiA 402: 0x06 shutdown, 0x07 switch on, 0x0F enable, 0x02 quick stop."""

import pytest

from hil_bench.abilities.drive.state_machine import STATUS, DriveState, DriveStateMachine

S = DriveState


@pytest.fixture
def machine():
    return DriveStateMachine()


def obey(machine, *words, may_enable=True, may_reset=True):
    for word in words:
        machine.receive(word, may_enable=may_enable, may_reset=may_reset)
    return machine.state


def test_control_words_lead_to_states():
    rows = [
        ([], S.SWITCH_ON_DISABLED),
        ([0x07], S.SWITCH_ON_DISABLED),  # needs a shutdown first
        ([0x0F], S.SWITCH_ON_DISABLED),
        ([0x06], S.READY_TO_SWITCH_ON),
        ([0x06, 0x07], S.SWITCHED_ON),
        ([0x06, 0x07, 0x0F], S.OPERATION_ENABLED),
        ([0x06, 0x0F], S.OPERATION_ENABLED),
        ([0x06, 0x0F, 0x07], S.SWITCHED_ON),
        ([0x06, 0x0F, 0x06], S.READY_TO_SWITCH_ON),
        ([0x06, 0x0F, 0x00], S.SWITCH_ON_DISABLED),
        ([0x06, 0x0F, 0x02], S.QUICK_STOP_ACTIVE),
        ([0x06, 0x0F, 0x02, 0x0F], S.QUICK_STOP_ACTIVE),
        ([0x06, 0x0F, 0x02, 0x00], S.SWITCH_ON_DISABLED),
        ([0x06, 0x02], S.SWITCH_ON_DISABLED),
    ]
    assert [(words, obey(DriveStateMachine(), *words)) for words, _ in rows] == rows


def test_bit_1_alone_disables_the_voltage():
    starts = [[0x06], [0x06, 0x07], [0x06, 0x0F], [0x06, 0x0F, 0x02]]
    words = [[*before, word] for before in starts for word in (0x01, 0x05, 0x09, 0x0D)]
    ends = [(each, obey(DriveStateMachine(), *each)) for each in words]
    assert ends == [(each, S.SWITCH_ON_DISABLED) for each in words]  # CiA 402: 0xxx xx0x


def test_without_permission_it_is_switched_on_only(machine):
    assert obey(machine, 0x06, 0x0F, may_enable=False) is S.SWITCHED_ON


def test_a_moving_axis_reacts_before_the_fault(machine):
    obey(machine, 0x06, 0x0F)
    machine.fault()
    assert machine.state is S.FAULT_REACTION
    assert obey(machine, 0x8F) is S.FAULT_REACTION
    machine.stand_still()
    assert machine.state is S.FAULT


def test_a_fault_is_left_by_a_rising_edge_only(machine):
    machine.fault()
    assert obey(machine, 0x06, 0x0F) is S.FAULT
    assert obey(machine, 0x80, may_reset=False) is S.FAULT
    assert obey(machine, 0x80) is S.FAULT  # it still stands
    assert obey(machine, 0x00, 0x80) is S.SWITCH_ON_DISABLED


def test_the_words_of_the_states():
    assert {state.name: word for state, word in STATUS.items()} == {
        "NOT_READY": 0x00,
        "SWITCH_ON_DISABLED": 0x40,
        "READY_TO_SWITCH_ON": 0x21,
        "SWITCHED_ON": 0x23,
        "OPERATION_ENABLED": 0x27,
        "QUICK_STOP_ACTIVE": 0x07,
        "FAULT_REACTION": 0x0F,
        "FAULT": 0x08,
    }
