"""Commissioning a virtual machine: sound, and with each fault that it must find and name."""

import dataclasses
import re

import can
import pytest
from support.machines import SOUND, SWAPPED, WRONG_REVISION, with_fault

from hil_bench import VirtualBench, load_config
from hil_bench.abilities.commissioning.measures import Verdict
from hil_bench.abilities.commissioning.plan import StepKind, load_plan
from hil_bench.abilities.commissioning.session import Console, commission
from hil_bench.canopen_device.frame import Frame
from hil_bench.devices.valve_state_machine import FAULT_STATES
from hil_drivers import Network

BENCH = "[bench]\ntick_us = 2000\nstep_us = 200\n"
PLAN = """
[plan]
period_ms = 4
[limits]
position_mm = [-150, 150]
speed_mm_s = 400
pressure_bar = [-1, 110]
[communication]
[sensors]
duration_s = 0.3
[direction]
"""
WHOLE_PLAN = f"""{PLAN.replace("period_ms = 4", "period_ms = 2")}
[dead_band]
duration_s = 3
[ramp]
duration_s = 2
[steps]
duration_s = 0.3
[chirp]
[leakage]
duration_s = 1
"""


class Machine:
    """A virtual machine, and the controller's side of it, which knows the data sheet only."""

    def __init__(self, folder, machine="", sheet="", plan=PLAN):
        self.bench = VirtualBench(self._config(folder / "machine.toml", machine))
        self.network = Network(self.bench.bus, clock=self.bench.now)
        self.bench.pump = self.network.pump
        self.sheet = self._config(folder / "sheet.toml", sheet)
        path = folder / "plan.toml"
        path.write_text(plan)
        self.plan = load_plan(path)
        self.axis = self.bench.bench.axes[0]

    @staticmethod
    def _config(path, text):
        path.write_text(BENCH + text)
        return load_config(path)

    def commission(self, **console):
        return commission(self.network, self.sheet, self.plan, console=Console(**console))

    def is_closed(self):
        return self.axis.valve.command(0) == 0.0

    def when_it_moves(self, act):
        """Do something once, in the middle of the first motion."""

        def observe(_now):
            if self.axis.plant.output.x > 5e-3:
                self.bench.observers.remove(observe)
                act()

        self.bench.observers.append(observe)


@pytest.fixture
def machine(tmp_path):
    return lambda *texts, **options: Machine(tmp_path, *texts, **options)


def verdicts(found):
    return [result.verdict for result in found.results]


def names(found):
    return [finding.name for finding in found.findings]


def value(found, name):
    (measure,) = [m for result in found.results for m in result.measures if m.name == name]
    return measure.value


@pytest.mark.long
def test_a_sound_machine_passes_and_its_data_sheet_is_found_again(machine):
    tested = machine(plan=WHOLE_PLAN)
    found = tested.commission()
    assert found.passed, [(r.kind, r.problem, r.measures) for r in found.results]
    assert names(found) == []
    assert [result.kind for result in found.results] == list(StepKind)
    # Table I: overlap 0.3 of 1.3 mm each side; friction 600 N and 2000 N s/m.
    assert value(found, "dead band") == pytest.approx(2 * 0.3 / 1.3, rel=0.12)
    assert value(found, "Coulomb friction") == pytest.approx(600, rel=0.25)
    assert value(found, "viscous friction") == pytest.approx(2000, rel=0.3)
    # omega^2 = E (A_A^2 / V_A + A_B^2 / V_B) / m = 447.5 rad/s = 71.2 Hz at mid-stroke.
    assert value(found, "eigenfrequency") == pytest.approx(71.2, rel=0.03)
    assert value(found, "effective bulk modulus") == pytest.approx(100.0, rel=0.06)
    assert tested.is_closed()
    assert tested.axis.valve.state.name in {"DISABLED", "INIT"}
    assert found.missed == 0
    assert [node.node_id for node in found.nodes] == [1, 2, 3, 4]


def test_swapped_pressure_sensors_are_named(machine):
    found = machine(SWAPPED).commission()
    assert names(found) == ["pressure sensors swapped"]
    assert verdicts(found)[-1] is Verdict.FAILED
    times = {result.kind: result.duration for result in found.results}
    assert times[StepKind.SENSORS] == pytest.approx(0.3, abs=0.05)  # as the plan has it


def test_a_wrong_revision_is_named_and_nothing_moves(machine):
    tested = machine(WRONG_REVISION)
    found = tested.commission(confirm=lambda: pytest.fail("asked to move"))
    assert names(found) == ["wrong EDS revision"]
    assert verdicts(found) == [Verdict.STOPPED, Verdict.NOT_RUN, Verdict.NOT_RUN]
    assert tested.bench.signals["axis1.spool_setpoint"].any() == 0


def test_another_mapping_is_named_and_other_settings_are_noted(machine):
    """The drivers set all else that they need; a mapping is the device's, and to be looked at."""
    changed = '[nodes.pressure_a.objects]\n"0x1A00.00" = 1\n"0x1017" = 500\n'
    tested = machine(SOUND + changed)
    found = tested.commission(confirm=lambda: pytest.fail("asked to move"))
    assert names(found) == ["another PDO mapping"]
    communication = found.results[0]
    assert communication.verdict is Verdict.STOPPED
    assert communication.findings[0].evidence.startswith("node 2 (pressure_a): 0x1A00.00 (")
    (note,) = communication.notes
    assert note.startswith("node 2 (pressure_a): 0x1017.00 (Producer heartbeat time) is 500; 0 by ")


def test_a_stuck_pressure_sensor_is_named(machine):
    found = machine(with_fault("freeze", "pressure_a")).commission()
    assert names(found) == ["pressure sensor stuck"]
    (finding,) = found.results[2].findings  # of the first motion
    assert re.match(r"P_A is \d+\.\d+ bar in all \d+ samples, while the pos", finding.evidence)


LEAKAGE_PLAN = PLAN + "[leakage]\nduration_s = 1\n"


def test_a_leaking_chamber_is_named(machine):
    leaking = "[plant.axis1]\nexternal_leakage_a_l_min_bar = 0.002\n"
    assert "leakage" in names(machine(leaking, plan=LEAKAGE_PLAN).commission())


def test_leaving_a_limit_closes_the_valve_at_once_and_says_which(machine):
    """A plan of 5 mm is refused beforehand; the machine's valve opens further than it should."""
    tested = machine()
    plan = tested.plan
    limits = dataclasses.replace(plan.steps[2].limits, position=(-0.15, 0.005))
    steps = (*plan.steps[:2], dataclasses.replace(plan.steps[2], limits=limits))
    tested.plan = dataclasses.replace(plan, steps=steps)
    result = tested.commission().results[-1]
    assert result.verdict is Verdict.STOPPED
    assert result.problem.startswith("position 5.")
    assert result.problem.endswith(" is beyond its limit of 5 mm; the valve was closed")
    assert tested.is_closed()
    # Two periods of 2 ms until it is seen and commanded, the spool's 3 ms, 65 mm/s or less
    # after the start's oscillation.
    assert tested.bench.signals["axis1.position"].max() < 5.0e-3 + 1.5e-3


def test_a_motion_ends_with_the_time_of_its_plan(machine):
    tested = machine(plan=f"{PLAN}time_s = 0.5\n")
    problem = "time 0.5 s is beyond its limit of 0.5 s; the valve was closed"
    assert tested.commission().results[-1].problem == problem
    assert tested.is_closed()


def test_a_computer_that_is_too_slow_is_told_and_nothing_is_concluded(machine):
    """Two of three samples are left out: each command costs 10 ms where 4 ms are asked for."""
    tested = machine()
    send = tested.network.sync

    def slow_sync():
        tested.bench.bus.advance(0.008)
        send()

    tested.network.sync = slow_sync
    found = tested.commission()
    sensors = found.results[1]
    assert names(found) == []
    assert sensors.verdict is Verdict.STOPPED
    assert "of the samples were left out: this computer or this bus is too slow for" in (
        sensors.problem
    )
    assert "period_ms = 4; give a longer one" in sensors.problem


def test_a_starting_position_that_is_not_reached_ends_the_motion(machine, monkeypatch):
    monkeypatch.setattr("hil_bench.abilities.commissioning.rig.APPROACH_TIME", 0.2)
    tested = machine(plan=PLAN + "[dead_band]\nposition_mm = [-20, 120]\n")
    result = tested.commission().results[-1]
    assert result.verdict is Verdict.STOPPED
    # The middle of the limits is 50 mm; half of the sweep's travel by the data sheet is less.
    assert result.problem.startswith("position 2")
    assert "not reached within 0.2 s; the valve was closed" in result.problem
    assert tested.is_closed()


@pytest.mark.parametrize("node_id", [1, 4])
def test_a_node_that_reboots_in_motion_closes_the_valve_at_once(machine, node_id):
    tested = machine(plan=LEAKAGE_PLAN)
    reset = can.Message(arbitration_id=0, data=[129, node_id], is_extended_id=False)
    tested.when_it_moves(lambda: tested.bench.bus.send(reset))
    found = tested.commission()
    assert verdicts(found)[2:] == [Verdict.STOPPED, Verdict.NOT_RUN]
    assert found.results[2].problem == f"node {node_id} rebooted; the valve was closed"
    assert tested.is_closed()
    frames = list(tested.bench.frames)
    boots = [number for number, logged in enumerate(frames) if is_boot_up(logged, node_id)]
    last = boots[-1]
    command = next(logged for logged in frames[last:] if logged.frame.can_id == 0x201)
    assert command.frame.data[2:4] == bytes(2)  # the first that it hears: set-point 0
    # It is read within a tick of 2 ms, and what is sent then is taken by the next.
    assert command.now - frames[last].now <= 2 * 2_000_000


@pytest.mark.parametrize(
    ("kind", "target", "problem"),
    [
        (
            "break_wire",
            "pressure_a",
            "pressure at A is not valid by the status of its sensor; the valve was ",
        ),
        ("silence", "pressure_b", "node 3: TPDO1 (COB-ID 0x183) came "),
        ("disable", "valve", "node 1: valve in DISABLED, no emergency message; the valve was cl"),
    ],
)
def test_a_value_that_is_none_in_motion_closes_the_valve(machine, kind, target, problem):
    tested = machine(plan=LEAKAGE_PLAN)
    tested.when_it_moves(lambda: getattr(tested.bench.faults, kind)(target))
    found = tested.commission()
    assert verdicts(found)[2:] == [Verdict.STOPPED, Verdict.NOT_RUN]
    assert found.results[2].problem.startswith(problem)
    assert tested.is_closed()


def test_a_valve_that_is_cut_off_in_motion_is_not_said_to_be_closed(machine):
    """It closes by itself, as its supervision of our commands was set up to do."""
    tested = machine()
    tested.when_it_moves(lambda: tested.bench.faults.silence("valve"))
    assert (
        tested.commission()
        .results[-1]
        .problem.endswith(
            "; the valve does not say that it is closed; without us it closes by itself"
        )
    )
    assert tested.is_closed()


def is_boot_up(logged, node_id):
    return logged.frame.can_id == 0x700 + node_id and logged.frame.data == bytes(1)


def test_a_valve_fault_in_motion_is_told(machine):
    tested = machine()
    reset_valve = can.Message(arbitration_id=0, data=[128, 1], is_extended_id=False)
    tested.when_it_moves(lambda: tested.bench.bus.send(reset_valve))  # NMT: PRE-OPERATIONAL
    direction = tested.commission().results[-1]
    assert direction.verdict is Verdict.STOPPED
    assert "node 1" in direction.problem
    assert tested.is_closed()


def test_a_node_that_answers_aborts_only_is_not_usable(machine):
    tested = machine()
    tick = tested.bench.bench.tick

    def abort(answer):
        return Frame(0x584, b"\x80" + answer.data[1:4] + (0x0800_0000).to_bytes(4, "little"))

    def tick_with_aborts(frames, now):
        return [abort(frame) if frame.can_id == 0x584 else frame for frame in tick(frames, now)]

    tested.bench.bench.tick = tick_with_aborts
    found = tested.commission()
    assert names(found) == ["node not usable"]
    assert "0x08000000" in found.findings[0].evidence


def test_half_the_nodes_missing_are_told_one_by_one_and_nothing_moves(machine):
    """Two of four are cut off the bus; the others are sound."""
    cut = with_fault("silence", "pressure_b") + with_fault("silence", "position").removeprefix(
        SOUND
    )
    tested = machine(cut)
    found = tested.commission(confirm=lambda: pytest.fail("asked to move"))
    assert [(finding.name, finding.evidence[:28]) for finding in found.findings] == [
        ("node missing", "node 3 (pressure_b): does no"),
        ("node missing", "node 4 (position): does not "),
    ]
    assert verdicts(found) == [Verdict.STOPPED, Verdict.NOT_RUN, Verdict.NOT_RUN]
    assert [node.node_id for node in found.nodes] == [1, 2]
    assert tested.bench.signals["axis1.spool_setpoint"].any() == 0


def test_a_silent_bus_is_told_node_by_node(make_file):
    with (
        can.Bus(interface="virtual", channel="test_silent") as bus,
        Network(bus, clock=(ticks := iter(range(10**9))).__next__) as network,
    ):
        del ticks
        path = make_file("plan.toml", PLAN)
        found = commission(network, load_config(), load_plan(path))
    assert names(found) == ["node missing"] * 4
    assert verdicts(found) == [Verdict.NOT_RUN] * 3
    assert found.verdict == "inconclusive"


def test_without_consent_nothing_moves(machine):
    tested = machine()
    found = tested.commission(confirm=lambda: False)
    assert verdicts(found) == [Verdict.PASSED, Verdict.PASSED, Verdict.NOT_RUN]
    assert found.results[-1].problem == "motion was not confirmed"
    assert found.verdict == "inconclusive"
    assert tested.bench.signals["axis1.spool_setpoint"].any() == 0


def test_an_interruption_closes_the_valve_and_leaves_what_was_found(machine):
    tested = machine(plan=LEAKAGE_PLAN)

    def interrupt():
        raise KeyboardInterrupt

    tested.when_it_moves(interrupt)
    found = tested.commission()
    assert verdicts(found)[2:] == [Verdict.STOPPED, Verdict.NOT_RUN]
    assert found.results[2].problem == "interrupted; the valve was closed"
    assert found.is_interrupted
    assert tested.is_closed()


@pytest.mark.parametrize("moment", ["begin", "end"])
def test_an_interruption_between_two_steps_leaves_what_was_found(machine, moment):
    """A program is between two steps where a console prints."""
    tested = machine(plan=LEAKAGE_PLAN)

    def interrupt(step):
        if step.kind is StepKind.SENSORS:
            raise KeyboardInterrupt

    found = tested.commission(**{moment: interrupt})
    sensors = Verdict.PASSED if moment == "end" else Verdict.NOT_RUN
    assert verdicts(found) == [Verdict.PASSED, sensors, Verdict.NOT_RUN, Verdict.NOT_RUN]
    assert found.is_interrupted
    assert tested.is_closed()


def test_a_lost_bus_ends_the_motion_and_leaves_what_was_found(machine):
    tested = machine(plan=LEAKAGE_PLAN)

    def lose():
        raise can.CanOperationError("the cable is out")

    def lose_the_bus():
        tested.bench.bus.send = lambda _message, _timeout=None: lose()

    tested.when_it_moves(lose_the_bus)
    found = tested.commission()
    assert verdicts(found)[2:] == [Verdict.STOPPED, Verdict.NOT_RUN]
    assert found.lost == (
        "the bus was lost: cannot send on embedded bench: the cable is out; the valve closes by "
        "itself"
    )


def test_a_controller_that_falls_silent_is_the_valves_to_notice(machine):
    """The set-up has the valve watch our commands: 0.1 s without one is a fault that closes it."""
    tested = machine()

    def fall_silent():
        tested.bench.bus.send = lambda _message, _timeout=None: None

    tested.when_it_moves(fall_silent)
    assert tested.commission().results[-1].verdict is Verdict.STOPPED
    tested.bench.run(0.2)
    assert tested.is_closed()
    assert tested.axis.valve.state in FAULT_STATES
