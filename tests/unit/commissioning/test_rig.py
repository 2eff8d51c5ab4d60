"""The rig of an axis: whatever ends a motion closes the valve first, and limits end it."""

import itertools
import math
from dataclasses import replace

import can
import pytest

from hil_bench import VirtualBench, load_config
from hil_bench.abilities.commissioning.plan import LimitError, Limits, Sample, check_sample
from hil_bench.abilities.commissioning.rig import Rig
from hil_bench.abilities.common.members import find_members
from hil_drivers import DriverError, Network, ValveState

PERIOD = 0.004  # [s], two ticks
LIMITS = Limits(position=(-0.15, 0.15), speed=0.4, pressure=(-1e5, 110e5), time=60.0)
OPEN = 0.4  # beyond the overlap of 0.3 of 1.3 mm


class Axis:
    """A virtual machine, and the rig that moves it."""

    def __init__(self, folder):
        path = folder / "bench.toml"
        path.write_text("[bench]\ntick_us = 2000\nstep_us = 200\n")
        config = load_config(path)
        self.bench = VirtualBench(config)
        self.network = Network(self.bench.bus, clock=self.bench.now)
        self.bench.pump = self.network.pump
        self.bench.run(0.01)
        self.recorded = []
        self.rig = Rig(
            self.network,
            find_members(config, "axis1", "commissioning"),
            period=PERIOD,
            recording=self,
        )
        self.rig.set_up()
        self.rig.watch(PERIOD)
        self.first_row = self.recorded.pop()
        self.rig.begin_step(3, LIMITS)

    def append_row(self, row):
        self.recorded.append(row)

    @property
    def valve(self):
        return self.bench.bench.axes[0].valve

    @property
    def is_closed(self):
        return self.valve.state.name == "DISABLED" and self.valve.command(0) == 0.0

    def open_valve(self):
        self.rig.enable()
        self.rig.move(lambda _time: OPEN, 0.02)
        assert self.valve.command(0) == pytest.approx(OPEN * 1.3e-3, rel=1e-3)

    def setpoints(self):
        """The set-points [increments] that the valve was sent, in their order."""
        return [
            int.from_bytes(logged.frame.data[2:4], "little", signed=True)
            for logged in self.bench.frames
            if logged.frame.can_id == 0x201
        ]


@pytest.fixture
def axis(tmp_path):
    made = Axis(tmp_path)
    yield made
    made.bench.bus.shutdown()


CAUSES = [
    *(ValueError, ArithmeticError, DriverError, LimitError, can.CanOperationError),
    *(KeyboardInterrupt, SystemExit, GeneratorExit, BaseException),
]


def test_whatever_ends_a_motion_closes_the_valve_first(axis):
    for cause in CAUSES:
        axis.open_valve()
        error = cause("in the middle")
        times = iter([OPEN, OPEN])

        def command(_time, times=times, error=error):
            for setpoint in times:
                return setpoint
            raise error

        with pytest.raises(cause) as raised:
            axis.rig.move(command, 1.0)
        assert raised.value is error
        assert axis.is_closed, cause


def test_whatever_ends_an_approach_closes_the_valve_first(axis):
    for cause in CAUSES:
        axis.open_valve()
        error = cause("in the middle")

        def approach(_distance, error=error):
            raise error

        with pytest.raises(cause) as raised:
            axis.rig.move_to(0.1, approach, timeout=1.0)
        assert raised.value is error
        assert axis.is_closed, cause


def test_a_motion_that_ends_well_leaves_the_valve_as_it_is(axis):
    axis.open_valve()
    assert not axis.is_closed
    assert axis.rig.close_valve()
    assert axis.is_closed


def test_the_valve_is_closed_once_and_again_only_after_it_was_enabled(axis):
    axis.open_valve()
    assert axis.rig.close_valve()
    sent = len(axis.setpoints())
    assert axis.rig.close_valve()
    assert len(axis.setpoints()) == sent
    axis.open_valve()
    assert axis.rig.close_valve()
    assert axis.is_closed


def test_a_valve_that_somebody_else_left_open_is_closed_too(axis):
    axis.rig.valve.enable()
    axis.rig.valve.spool_setpoint = OPEN
    axis.bench.run(0.01)
    assert not axis.is_closed
    assert axis.rig.close_valve()
    assert axis.is_closed


def test_a_valve_that_will_not_be_disabled_is_closed_where_it_says_so(axis, monkeypatch):
    # CiA 408 device states in which the spool follows nobody.
    closed = {
        *(ValveState.NOT_READY, ValveState.INIT),
        *(ValveState.DISABLED, ValveState.FAULT_DISABLED),
    }

    def refuse():
        raise DriverError("refused")

    for state in ValveState:
        axis.open_valve()
        with monkeypatch.context() as patch:
            patch.setattr(axis.rig.valve, "disable", refuse)
            patch.setattr(axis.rig.valve, "read_state", lambda state=state: state)
            assert axis.rig.close_valve() is (state in closed)
            axis.bench.run(0.01)
            assert axis.setpoints()[-1] == 0  # whatever it says, its spool is centred
            assert axis.rig.close_valve() is (state in closed)  # it is remembered


def test_a_valve_that_says_nothing_is_not_said_to_be_closed(axis):
    axis.open_valve()
    axis.bench.faults.silence("valve")
    assert not axis.rig.close_valve()


def test_a_motion_samples_a_grid_and_commands_each_of_its_times(axis):
    axis.rig.enable()
    times = []

    def command(time):
        times.append(time)
        return 0.0

    samples = axis.rig.move(command, 0.02)
    grid = [0.0, 0.004, 0.008, 0.012, 0.016]  # 0.02 s each 4 ms
    assert times == pytest.approx(grid)
    assert samples["time"] == pytest.approx(grid, abs=0.002)  # a tick, after which frames are read
    assert axis.rig.missed == 0
    assert [row[-1] for row in axis.recorded] == [3.0] * 5  # the number of the step
    values = [row[1:7] for row in axis.recorded]
    assert values == [tuple(sample)[1:] for sample in samples.tolist()]


def test_what_is_sampled_before_the_first_step_has_the_number_0(axis):
    assert axis.first_row[-1] == 0.0


def test_an_answer_that_does_not_come_is_missed(axis):
    axis.bench.faults.silence("pressure_b")
    start = axis.network.now()
    with pytest.raises(DriverError, match=r"^node 3: TPDO1"):
        axis.rig.watch(10.0)
    # Each cycle waits for its answer for 0.1 s, until the value itself is too old to be read.
    waited = axis.network.now() - start
    assert axis.rig.missed == round(waited / 0.1) > 0


def test_a_valve_with_a_fault_is_enabled_too(axis):
    axis.open_valve()
    axis.bench.run(0.2)  # its supervision of commands ends after 0.1 s
    assert axis.valve.state.name == "FAULT_HOLD"
    axis.rig.enable()
    assert axis.valve.state.name == "ACTIVE"


def test_watching_commands_nothing(axis):
    before = len(axis.setpoints())
    samples = axis.rig.watch(0.02)
    assert len(samples) == 5
    assert len(axis.setpoints()) == before


@pytest.mark.parametrize(("count", "ends"), [(10, False), (11, True)])
def test_a_tenth_of_the_samples_may_be_left_out(axis, count, ends):
    """Of 100 samples, `count` are left out: so many SYNCs go out 6 ms late.

    Their answer takes a tick of 2 ms more, which makes two periods in place of one.
    """
    send, late = axis.network.sync, iter([True] * count)

    def slow_sync():
        if next(late, False):
            axis.bench.bus.advance(PERIOD + 0.002)
        send()

    axis.network.sync = slow_sync
    if ends:
        with pytest.raises(LimitError, match=r"11% of the samples .*period_ms = 4; give"):
            axis.rig.watch(0.4)
    else:
        assert len(axis.rig.watch(0.4)) == 100 - count


def test_an_approach_ends_where_the_piston_stands_at_its_target(axis):
    axis.rig.enable()

    def approach(distance):
        return 0.0 if abs(distance) < 1e-3 else math.copysign(OPEN, distance)

    axis.rig.move_to(0.01, approach, timeout=5.0)
    output = axis.bench.bench.axes[0].plant.output
    assert output.x == pytest.approx(0.01, abs=2e-3)
    assert abs(output.v) < 2e-3
    assert axis.setpoints()[-1] == 0
    assert not axis.is_closed  # it stays enabled for what follows


def test_an_approach_begins_and_ends_with_a_closed_valve(axis):
    axis.rig.enable()
    before = len(axis.setpoints())
    axis.rig.move_to(0.0, lambda _distance: 0.0, timeout=1.0)  # it is there already
    axis.bench.run(PERIOD)  # so that the last command gets there
    assert set(axis.setpoints()[before:]) == {0}


def test_an_approach_that_takes_too_long_closes_the_valve(axis):
    axis.rig.enable()
    start, axis.recorded[:] = axis.network.now(), []
    with pytest.raises(LimitError, match=r"^position 100 mm not reached within 0\.1 s$"):
        axis.rig.move_to(0.1, lambda _distance: OPEN, timeout=0.1)
    assert axis.network.now() - start == pytest.approx(0.1, abs=0.05)
    assert axis.is_closed
    times = [row[0] for row in axis.recorded]
    gaps = [after - before for before, after in itertools.pairwise(times)]
    assert len(gaps) > 20
    assert gaps == pytest.approx([PERIOD] * len(gaps))


def test_the_time_of_a_step_begins_with_it(axis):
    axis.bench.run(1.0)
    axis.rig.begin_step(4, replace(LIMITS, time=0.1))
    axis.rig.watch(0.09)
    with pytest.raises(LimitError, match=r"time 0\.1 s is beyond its limit of 0\.1 s"):
        axis.rig.watch(0.09)


def sample(**values):
    fields = dict.fromkeys(Sample._fields, 0.0)
    return Sample(**(fields | values))


@pytest.mark.parametrize(
    ("field", "low", "high"),
    [
        ("position", -0.15, 0.15),
        ("speed", -0.4, 0.4),
        ("pressure_a", -1e5, 110e5),
        ("pressure_b", -1e5, 110e5),
    ],
)
def test_a_limit_itself_is_allowed_and_what_is_next_to_it_is_not(field, low, high):
    for value in (low, 0.0, high):
        check_sample(sample(**{field: value}), LIMITS)
    for value in (math.nextafter(low, -math.inf), math.nextafter(high, math.inf)):
        with pytest.raises(LimitError, match="is beyond its limit of"):
            check_sample(sample(**{field: value}), LIMITS)
    with pytest.raises(LimitError, match="is not valid by the status of its sensor"):
        check_sample(sample(**{field: math.nan}), LIMITS)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"position": 0.2}, "position 200 mm is beyond its limit of 150 mm"),
        ({"position": -0.2}, "position -200 mm is beyond its limit of -150 mm"),
        ({"speed": -0.5}, "speed -500 mm/s is beyond its limit of -400 mm/s"),
        ({"pressure_a": 120e5}, "pressure at A 120 bar is beyond its limit of 110 bar"),
        ({"pressure_b": -2e5}, "pressure at B -2 bar is beyond its limit of -1 bar"),
    ],
)
def test_a_limit_is_told_in_the_units_of_the_plan(values, text):
    with pytest.raises(LimitError) as raised:
        check_sample(sample(**values), LIMITS)
    assert str(raised.value) == text


@pytest.mark.parametrize(
    ("position", "speed", "is_allowed"),
    [
        (0.19, 0.04, True),  # 13 mm before the limit, slowly
        (0.19, 0.06, False),
        (0.19, -0.3, True),  # away from the stop
        (-0.19, -0.06, False),
        (-0.19, 0.3, True),
        (0.18, 0.3, True),  # 23 mm before the limit
    ],
)
def test_towards_an_end_stop_the_contact_speed_holds(position, speed, is_allowed):
    limits = replace(LIMITS, position=(-0.203, 0.203), contact_speed=0.05)
    one = sample(position=position, speed=speed)
    if is_allowed:
        check_sample(one, limits)
        return
    with pytest.raises(LimitError, match=r"^speed at the end stop .*beyond its limit of -?50 mm/s"):
        check_sample(one, limits)
