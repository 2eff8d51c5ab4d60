"""Commands to a running bench: when they act, in which order, and what they answer."""

import pickle
import threading
from concurrent.futures import CancelledError

import pytest

from hil_bench import Faults, VirtualBench, load_config
from hil_bench.abilities.common.commands import SetObject, SetPlant
from hil_bench.abilities.faults.commands import BeginFault, ClearFault
from hil_bench.bench.commands import MOST_WAITING
from hil_bench.bench.session import open_session
from hil_bench.errors import ConfigError, ControllerError

TICK = 1_000_000


class Ticking:
    """A session and its time."""

    def __init__(self):
        self.session = open_session(load_config())
        self.session.start()
        self.now = -TICK
        self.tick()

    def tick(self, count=1):
        for _ in range(count):
            self.now += TICK
            self.session.tick((), self.now)

    def ask(self, command):
        """Return the answer, or raise the error, of a command that acts in the next tick."""
        answer = self.session.door.put(command)
        assert not answer.done()
        self.tick()
        return answer.result(timeout=0)

    @property
    def active(self):
        return [(str(f.kind), f.target) for f in self.session.bench.part(Faults).active]


@pytest.fixture
def bench():
    return Ticking()


def test_a_fault_begins_and_ends_with_the_next_tick(bench):
    number = bench.ask(BeginFault("offset", "pressure_a", {"amount": 2e6}))
    assert bench.active == [("offset", "pressure_a")]
    pressures = {sensor.name: sensor for sensor in bench.session.bench.sensors}
    output = bench.session.bench.axes[0].plant.output
    assert pressures["pressure_a"].measured == pytest.approx(output.P_A + 2e6)
    bench.ask(ClearFault(number))
    assert bench.active == []
    events = [(event.time, event.is_begin) for event in bench.session.bench.part(Faults).events]
    # Tick 1 began it; cleared at the start of tick 2, it was there until tick 1.
    assert events == [(TICK, True), (TICK, False)]


def test_all_faults_end_at_once_planned_ones_too(bench):
    bench.ask(BeginFault("freeze", "position"))
    number = bench.ask(BeginFault("stick", "valve", {"at": 0.005}))
    bench.ask(ClearFault())
    bench.tick(10)
    assert bench.active == []
    with pytest.raises(ConfigError, match=f"fault {number}: there is no such number"):
        bench.ask(ClearFault(number))


def test_a_fault_that_is_over_has_no_number_any_more(bench):
    active = bench.ask(BeginFault("noise", "position", {"rms": 1e-6}))
    first = bench.ask(BeginFault("freeze", "position", {"duration": 0.002}))
    planned = bench.ask(BeginFault("stick", "valve", {"at": 1.0}))
    bench.tick(5)
    last = bench.ask(BeginFault("freeze", "pressure_a"))
    there = f"{active}, {planned}, {last}"
    with pytest.raises(
        ConfigError, match=f"^fault {first}: there is no such number; there is: {there}$"
    ):
        bench.ask(ClearFault(first))


def test_an_object_is_set_as_python_sets_it(bench):
    assert bench.ask(SetObject("valve", "0x1017", 250)) == 250
    assert bench.session.nodes["valve"]["0x1017"] == 250


def test_a_load_pushes_the_piston_back(bench):
    plant = bench.session.bench.axes[0].plant
    p = plant.parameters
    assert plant.output.x == pytest.approx(0.0, abs=1e-12)
    bench.ask(SetPlant("axis1", "load", 5000))
    bench.tick(50)
    # With both ports shut the oil is a spring: k = E (A_A^2 / V_A0 + A_B^2 / V_B0). F_L of eq. (12)
    # counts against positive motion, and friction holds up to F_s of it.
    stiffness = p.E * (p.A_A**2 / p.V_A0 + p.A_B**2 / p.V_B0)
    assert -(5000 + p.F_s) / stiffness < plant.output.x < -(5000 - p.F_s) / stiffness


def test_a_supply_pressure_holds(bench):
    bench.ask(SetPlant("axis1", "supply_pressure", 42e5))
    bench.tick(3)
    assert bench.session.bench.axes[0].plant.supply_pressure == 42e5


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (BeginFault("melt", "valve"), 'fault: there is no kind "melt"; give one of freeze, '),
        (
            BeginFault("freeze", "wheel"),
            'faults: there is no sensor "wheel"; give one of pressure_a',
        ),
        (BeginFault("freeze", "position", {"amount": 3}), "fault freeze position: "),
        (BeginFault("offset", "position"), "fault offset position: "),
        (SetObject("wheel", "0x1017", 1), 'nodes: there is no node "wheel"; give one of valve'),
        (SetObject("valve", "0x1018", "x"), "nodes.valve: 0x1018"),
        (SetPlant("axis9", "load", 1), 'axis "axis9": there is no such axis; there is: axis1'),
        (SetPlant("axis1", "mass", 1), 'axis1.mass: cannot be set; give "load" or "supply_'),
        (SetPlant("axis1", "load", float("nan")), "axis1.load = nan: give -1e+09 to 1e+09 N"),
        (SetPlant("axis1", "load", "much"), "axis1.load = 'much': give -1e+09 to 1e+09 N"),
        (SetPlant("axis1", "supply_pressure", -1.0), "axis1.supply_pressure = -1.0: give 0 to 1e"),
    ],
)
def test_a_command_that_cannot_be_obeyed_says_why_and_the_bench_goes_on(bench, command, message):
    with pytest.raises(ConfigError) as refusal:
        bench.ask(command)
    assert str(refusal.value).startswith(message)
    assert bench.ask(SetObject("valve", "0x1017", 100)) == 100


def test_even_an_error_of_ours_leaves_the_bench_running(bench):
    class Broken:
        def act(self, _controls, _now):
            return 1 / 0

    answer = bench.session.door.put(Broken())
    bench.tick()
    with pytest.raises(ZeroDivisionError):
        answer.result(timeout=0)


def test_commands_act_in_their_order_all_in_one_tick(bench):
    door = bench.session.door
    answers = [door.put(SetObject("valve", "0x1017", value)) for value in (10, 20, 30)]
    answers[1].cancel()
    bench.tick()
    assert (answers[0].result(0), answers[2].result(0)) == (10, 30)
    with pytest.raises(CancelledError):
        answers[1].result(0)


def test_a_command_passes_to_another_process_as_it_is():
    command = BeginFault("offset", "pressure_a", {"amount": 2e6})
    assert pickle.loads(pickle.dumps(command)) == command  # noqa: S301 - our own


def test_a_closed_door_turns_all_away(bench):
    waiting = bench.session.door.put(ClearFault())
    bench.session.door.close()
    with pytest.raises(ControllerError, match=r"^the bench ended before its next tick$"):
        waiting.result(timeout=0)
    with pytest.raises(ControllerError, match=r"^the bench has ended"):
        bench.session.door.put(ClearFault())


def test_a_flood_of_commands_is_bounded(bench):
    for _ in range(MOST_WAITING):
        bench.session.door.put(ClearFault())
    with pytest.raises(ControllerError, match=f"^{MOST_WAITING} commands wait"):
        bench.session.door.put(ClearFault())
    bench.tick()
    bench.ask(ClearFault())


def test_another_thread_commands_a_virtual_bench():
    answers = []
    with VirtualBench() as bench:
        thread = threading.Thread(
            target=lambda: answers.append(bench.session.door.put(BeginFault("freeze", "position")))
        )
        thread.start()
        thread.join()
        bench.run(0.001)
        assert answers[0].result(timeout=0) == 1
        assert [fault.target for fault in bench.faults.active] == ["position"]
    with pytest.raises(ControllerError):
        bench.session.door.put(ClearFault())


def test_the_same_commands_before_the_same_ticks_are_the_same_run():
    def positions():
        rows = []
        bench = Ticking()
        bench.session.watch(rows=rows.append)
        bench.ask(BeginFault("noise", "position", {"rms": 1e-4}))
        bench.ask(SetPlant("axis1", "load", 5000))
        bench.tick(100)
        return rows

    assert positions() == positions()
