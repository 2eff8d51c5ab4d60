"""A mailbox whose poster is replaced while orders wait."""

import pytest

from hil_bench.abilities.modbus.protocol.mailbox import SLOTS, Mailbox
from hil_bench.abilities.modbus.protocol.register_map import Assignment


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
