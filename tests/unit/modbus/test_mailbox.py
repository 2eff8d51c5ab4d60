"""Orders and answers in shared memory."""

import ctypes

import pytest

from hil_bench.modbus.mailbox import MOST_ASSIGNMENTS, SLOTS, Mailbox
from hil_bench.modbus.unit_image import Assignment


def test_an_order_goes_over_and_its_answer_comes_back():
    box = Mailbox()
    assert box.take() is None
    number = box.post([Assignment(3, 0.5), Assignment(700, -1e300)])
    assert box.answer_of(number) is None
    order = box.take()
    assert order.number == number
    assert order.assignments == [Assignment(3, 0.5), Assignment(700, -1e300)]
    assert box.take() is None
    box.answer(number, 3)
    assert box.answer_of(number) == 3


def test_orders_come_in_their_order_over_many_rounds():
    box = Mailbox()
    for round_ in range(3 * SLOTS):
        numbers = [box.post([Assignment(round_, float(k))]) for k in range(3)]
        for k, number in enumerate(numbers):
            assert box.take() == (number, [Assignment(round_, float(k))])
            box.answer(number, 0)
        assert [box.answer_of(number) for number in numbers] == [0, 0, 0]


def test_a_full_box_refuses_until_an_answer_makes_room():
    box = Mailbox()
    assert None not in [box.post([]) for _ in range(SLOTS)]
    assert box.post([]) is None
    box.answer(box.take().number, 0)
    assert box.post([]) == SLOTS + 1
    assert box.post([]) is None


def test_what_nobody_waits_for_any_longer_takes_no_room_for_ever():
    box = Mailbox()
    for number in [box.post([Assignment(0, 1.0)]) for _ in range(SLOTS)]:
        box.withdraw(number)
    for _ in range(SLOTS):
        order = box.take()
        assert order.assignments == []
        box.answer(order.number, 0)
    assert box.post([Assignment(0, 1.0)]) is not None


def test_more_than_fits_is_refused():
    pair = Assignment(1, 1.0)
    assert Mailbox().post([pair] * (MOST_ASSIGNMENTS + 1)) is None
    box = Mailbox()
    box.post([pair] * MOST_ASSIGNMENTS)
    assert box.take().assignments == [pair] * MOST_ASSIGNMENTS


@pytest.mark.parametrize("damaged", [8, 12, 20])
def test_a_half_written_order_is_not_there_yet(damaged):
    box = Mailbox()
    box.post([Assignment(1, 2.0)])
    # The first order stands in the second slot, of 16 head bytes and 10 a value.
    position = 16 + 10 * MOST_ASSIGNMENTS + damaged
    memory = (ctypes.c_uint8 * ctypes.sizeof(box._orders)).from_buffer(box._orders)
    memory[position] ^= 0x40
    assert box.take() is None
    memory[position] ^= 0x40
    assert box.take() is not None


def test_an_answer_of_an_earlier_round_is_none():
    box = Mailbox()
    for _ in range(SLOTS):
        box.answer(box.post([]) and box.take().number, 0)
    assert box.answer_of(box.post([])) is None
