"""The frames of the example as it is flashed are those of its build for the host.

Only the time of a reaction may differ: the host computes in no time, a chip by its instructions. So
the host's run on the bench is taken down, and each chip is answered by cause: what the bench
sent behind the host's n-th frame comes behind the chip's n-th.
"""

from itertools import pairwise
from typing import NamedTuple

import pytest
from support.chip_programs import CAN_BUILD, WHY_NOT, build_example

from hil_bench import TimedFrame, VirtualBench, load_config
from hil_bench.canopen_device.frame import Frame

pytest.importorskip("unicorn")

from hil_bench.abilities.controllers.elf.job import Job
from hil_bench.abilities.controllers.elf.machine import Machine

pytestmark = pytest.mark.skipif(not CAN_BUILD, reason=WHY_NOT)

TICK = 250_000
MS = 1_000_000
SYNC, HEARTBEAT = 0x80, 0x77F
REACTION = 20_000
"""From the millisecond of a cycle to its SYNC: 400 of 20,000 instructions a millisecond [ns]."""


class Passed(NamedTuple):
    frame: Frame
    is_controllers: bool


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    names = ("stm32f4.elf", "stm32g4.elf", "libposition_control.so")
    return build_example(tmp_path_factory.mktemp("built"), *names)


@pytest.fixture(scope="module")
def passed(built):
    """The frames of the host's build on the bench in their order, but for its heartbeats."""
    settings = {"targets_mm": "50,-20"}
    library = str(built / "libposition_control.so")
    controller = {"kind": "library", "library": library, "settings": settings}
    tables = {"bench": {"tick_us": TICK // 1000}, "controllers": {"axis": controller}}
    found: list[Passed] = []

    def keep(received, sent, _now):
        found.extend(Passed(each, is_controllers=True) for each in received if not is_beat(each))
        found.extend(Passed(each, is_controllers=False) for each in sent)

    with VirtualBench(load_config(tables=tables)) as bench:
        bench.session.watch(frames=keep)
        bench.run(0.7)
    return found


def is_beat(frame):
    return frame.can_id == HEARTBEAT


def answers(passed):
    """Yield each frame of the controller, and what came behind it; first what came before."""
    at: tuple[Frame | None, list[Frame]] = None, []
    for frame, is_controllers in passed:
        if is_controllers:
            yield at
            at = frame, []
        else:
            at[1].append(frame)
    yield at


@pytest.mark.parametrize(("name", "chip"), [("stm32f4", "STM32F407"), ("stm32g4", "STM32G431")])
def test_a_chip_sends_what_the_host_sends(built, passed, name, chip):
    machine = Machine(Job(built / f"{name}.elf", chip, 20_000, 8_000_000, (1,), (0,)))
    expected = list(answers(passed))
    assert sum(1 for frame, _ in expected if frame and frame.can_id == SYNC) > 600
    sent: list[TimedFrame] = []
    heard: list[TimedFrame] = [TimedFrame(0, each) for each in expected[0][1]]
    now, count = 0, 1
    while count < len(expected):
        now += TICK
        assert now < 1000 * MS, f"silent behind {expected[count - 1][0]}"
        new, heard = machine.advance(now, heard), []
        sent += new
        for _, frame in new:
            if not is_beat(frame) and count < len(expected):
                assert frame == expected[count][0], f"frame {count}"
                heard += [TimedFrame(now, each) for each in expected[count][1]]
                count += 1
    times = [time for time, frame in sent if frame.can_id == SYNC]
    late = [time - times[0] - cycle * MS for cycle, time in enumerate(times)]
    assert max(late) - min(late) <= REACTION
    beats = [time for time, frame in sent if is_beat(frame)]
    assert len(beats) > 10
    # Each 50 ms, with the first cycle behind that.
    assert all(49 * MS < later - time < 52 * MS for time, later in pairwise(beats))
