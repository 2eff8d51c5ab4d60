"""Orders and answers in shared memory."""

import ctypes

import pytest

from hil_bench.abilities.modbus.protocol.mailbox import MOST_ASSIGNMENTS, SLOTS, Mailbox
from hil_bench.abilities.modbus.protocol.register_map import Assignment


def test_an_order_goes_over_and_its_answer_comes_back():
    box = Mailbox()
    assert box.take() is None
    number = box.post(
        [Assignment(3, 0.5), Assignment(700, -1e300), Assignment(1, 7.0, is_mask=True)]
    )
    assert box.answer_of(number) is None
    order = box.take()
    assert order.number == number
    assert order.assignments == [
        Assignment(3, 0.5),
        Assignment(700, -1e300),
        Assignment(1, 7.0, is_mask=True),
    ]
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
    assert not box._codes  # nor do their answers
    assert not box._unwanted


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
    # The first order stands in the second slot, of 16 head bytes and 11 a value.
    position = 16 + 11 * MOST_ASSIGNMENTS + damaged
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


def successor(box):
    """The mailbox as a new server process has it: the same memory, and the loop's own counters."""
    after = Mailbox()
    after._orders, after._answers = box._orders, box._answers
    after.resume()
    return after


def poke(box, number, offset):
    """Damage a byte of an order's slot."""
    memory = (ctypes.c_uint8 * ctypes.sizeof(box._orders)).from_buffer(box._orders)
    memory[number % SLOTS * (16 + 11 * MOST_ASSIGNMENTS) + offset] ^= 0x40


@pytest.mark.parametrize("before", [0, 1, SLOTS - 1, SLOTS, 3 * SLOTS + 5])
@pytest.mark.parametrize("waiting", [0, 1, SLOTS - 1])
def test_a_new_poster_goes_on_where_the_old_one_died(before, waiting):
    loop = Mailbox()
    poster = loop  # the same counters do for both sides while nobody dies
    for value in range(before):
        poster.post([Assignment(0, float(value))])
        loop.answer(loop.take().number, 0)
    for value in range(waiting):
        poster.post([Assignment(1, float(value))])
    poster = successor(loop)
    number = poster.post([Assignment(2, 7.0)])
    taken = []
    while (order := loop.take()) is not None:
        taken += order.assignments
        assert poster.answer_of(order.number) is None
        loop.answer(order.number, 0)
    # Each order once, in its order, and the new one is answered as itself.
    assert taken == [*(Assignment(1, float(value)) for value in range(waiting)), Assignment(2, 7.0)]
    assert number == before + waiting + 1
    assert poster.answer_of(number) == 0


@pytest.mark.parametrize("damaged", [8, 12, 20])
def test_an_order_that_was_half_written_at_the_death_holds_nobody_up(damaged):
    loop = Mailbox()
    loop.post([Assignment(0, 1.0)])
    half = loop.post([Assignment(1, 1.0)])
    last = loop.post([Assignment(2, 1.0)])
    poke(loop, half, damaged)
    poster = successor(loop)
    number = poster.post([Assignment(3, 1.0)])
    assert [loop.take().assignments for _ in range(4)] == [
        [Assignment(0, 1.0)],
        [],
        [Assignment(2, 1.0)],
        [Assignment(3, 1.0)],
    ]
    assert number == last + 1


def test_the_last_order_half_written_holds_nobody_up_either():
    loop = Mailbox()
    half = loop.post([Assignment(0, 1.0)])
    poke(loop, half, 12)
    poster = successor(loop)
    poster.post([Assignment(1, 1.0)])
    assert [loop.take().assignments for _ in range(2)] == [[], [Assignment(1, 1.0)]]


def test_an_order_that_was_taken_before_it_was_damaged_is_not_answered_for_another():
    # The old server died as it withdrew an order that the loop had taken already: the answer that
    # the loop still owes is the old order's.
    loop = Mailbox()
    taken = loop.post([Assignment(0, 1.0)])
    assert loop.take().number == taken
    poke(loop, taken, 12)
    poster = successor(loop)
    number = poster.post([Assignment(1, 2.0)])
    loop.answer(taken, 0)
    assert poster.answer_of(number) is None
    assert loop.take().assignments == [Assignment(1, 2.0)]


def test_a_full_box_is_full_for_the_new_poster_too():
    loop = Mailbox()
    for _ in range(SLOTS):
        loop.post([Assignment(0, 1.0)])
    poster = successor(loop)
    assert poster.post([]) is None
    loop.answer(loop.take().number, 0)
    assert poster.post([]) == SLOTS + 1


# A mailbox whose poster is replaced while orders wait.


def answered(box, count):
    for _ in range(count):
        box.post([Assignment(0, 0.0)])
        box.answer(box.take().number, 0)


@pytest.mark.parametrize("before", [0, 1, SLOTS - 1, SLOTS, 3 * SLOTS + 5])
@pytest.mark.parametrize("waiting", [0, 1, SLOTS - 1, SLOTS])
def test_all_that_wait_are_obeyed_once_and_the_next_comes_behind_them(before, waiting):
    box = Mailbox()
    answered(box, before)
    for number in range(waiting):
        assert box.post([Assignment(number, 1.0)]) == before + number + 1
    box.resume()
    following = box.post([Assignment(99, 2.0)])
    assert following == (None if waiting == SLOTS else before + waiting + 1)
    positions = []
    while order := box.take():
        positions += [assignment.position for assignment in order.assignments]
    assert positions == [*range(waiting), *([] if following is None else [99])]
