"""Objects bound to quantities of the plant, on the module of `analogue_io_401.eds`."""

import math

import pytest

from device_profiles import IMITATIONS
from hil_bench.canopen_device.datatypes import (
    DATA_TYPES,
    INTEGER16,
    REAL32,
    UNSIGNED8,
    IntegerType,
    RealType,
)
from hil_bench.canopen_device.object_dictionary import Variable
from hil_bench.devices.bound_objects import CommandWatch, QuantitySource, SpoolSink

EDS = IMITATIONS / "analogue_io_401.eds"
NUMBERS = [kind for kind in DATA_TYPES.values() if isinstance(kind, IntegerType | RealType)]
FULL_OPENING = 1.3e-3
SAFE = -0.05


@pytest.fixture
def rig(make_rig):
    rig = make_rig(EDS)
    rig.tick()  # boot
    return rig


@pytest.fixture
def show(rig):
    """Publish a quantity to a variable of its own; gives the value that it has then."""

    def show(quantity, data_type, *, scale=1.0, offset=0.0, **limits):
        variable = Variable(0x2000, 1, "bound", data_type, **limits)
        QuantitySource(rig.node, variable, scale, offset, None).publish(quantity)
        return variable.value

    return show


@pytest.mark.parametrize(
    ("quantity", "scale", "offset", "value"),
    # value = quantity * scale + offset, to the nearest integer, at most that of INTEGER16.
    [
        (100.0, 110.592, 0.0, 11059),  # 11059.2
        (-100.0, 110.592, 0.0, -11059),
        (-50.0, 69.12, 13824.0, 10368),  # 13824 - 3456
        (2.0, -1.0, 0.0, -2),
        (1.4999, 1.0, 0.0, 1),
        (1.5001, 1.0, 0.0, 2),
        (1e6, 1.0, 0.0, 32767),
        (-1e6, 1.0, 0.0, -32768),
        (math.inf, 1.0, 0.0, 32767),
    ],
)
def test_an_integer_is_the_nearest_one(show, quantity, scale, offset, value):
    shown = show(quantity, INTEGER16, scale=scale, offset=offset)
    assert shown == value
    assert isinstance(shown, int)


@pytest.mark.parametrize("data_type", NUMBERS, ids=repr)
def test_what_is_shown_can_be_sent(show, data_type):
    for quantity in (-math.inf, -1e300, -1e30, -1.0, 0.4, 1e30, 1e300, math.inf):
        assert len(data_type.encode(show(quantity, data_type))) == data_type.size


def test_the_limits_of_the_eds_come_before_those_of_the_type(show):
    limits = {"low": 10, "high": 200}
    assert show(3.0, UNSIGNED8, default=10, **limits) == 10
    assert show(250.0, UNSIGNED8, default=10, **limits) == 200
    assert show(-3.5, REAL32, low=-2.0, high=2.0) == -2.0


def test_a_real_number_is_not_rounded(show):
    assert show(1.25, REAL32, scale=3.0, offset=-0.5) == 3.25


def test_no_number_changes_nothing(show):
    assert show(math.nan, INTEGER16, default=7) == 7


@pytest.fixture
def source(rig):
    """Input 1, event of its TPDO 2 at a change of more than 10 increments."""
    rig.write(0x1801, 5, 0, 2)  # event timer off
    rig.source = QuantitySource(
        rig.node, rig.object_dictionary.variable(0x6401, 1), scale=1.0, offset=0.0, delta=10.0
    )
    rig.quantity = 0.0
    rig.work = lambda _now: rig.source.publish(rig.quantity)
    rig.nmt(rig.START)
    rig.tick(5)
    rig.sent(0x285)
    return rig


def shown(rig):
    """Input 1 in each TPDO 2 sent since the last look."""
    return [int.from_bytes(data[:2], "little", signed=True) for data in rig.sent(0x285)]


def test_a_change_beyond_delta_is_sent_once(source):
    source.quantity = 10.0  # the delta itself is no event
    source.tick(3)
    assert shown(source) == []
    source.quantity = -11.0
    source.tick(3)
    assert shown(source) == [-11]
    source.quantity = -1.0  # ten from what was told last
    source.tick(3)
    assert shown(source) == []
    source.quantity = 0.0
    source.tick(3)
    assert shown(source) == [0]


def test_without_delta_nothing_is_sent(rig):
    rig.write(0x1801, 5, 0, 2)
    variable = rig.object_dictionary.variable(0x6401, 1)
    source = QuantitySource(rig.node, variable, scale=1.0, offset=0.0, delta=None)
    rig.nmt(rig.START)
    rig.tick()
    rig.sent(0x285)
    for quantity in range(0, 30000, 1000):
        source.publish(quantity)
        rig.tick()
    assert shown(rig) == []


@pytest.fixture
def sink(rig):
    """Output 1, 20000 increments for 100 % around 100, with the node OPERATIONAL."""
    rig.sink = SpoolSink(
        CommandWatch(rig.node),
        rig.object_dictionary.variable(0x6411, 1),
        scale=20000.0,
        offset=100.0,
        safe=SAFE,
        full_opening=FULL_OPENING,
    )

    def work(now):
        rig.share = rig.sink.command(now) / FULL_OPENING

    rig.work = work
    rig.nmt(rig.START)
    rig.tick()
    return rig


def send(rig, value):
    """RPDO 2 with output 1."""
    rig.receive(0x305, *value.to_bytes(2, "little", signed=True), 0, 0)


@pytest.mark.parametrize(
    ("value", "share"),
    # (value - 100) / 20000, held at 100 %.
    [(100, 0.0), (10100, 0.5), (-9900, -0.5), (32767, 1.0), (-32768, -1.0)],
)
def test_the_object_commands_the_spool(sink, value, share):
    send(sink, value)
    sink.tick()
    assert sink.share == pytest.approx(share, abs=1e-12)
    sink.tick(100)
    assert sink.share == pytest.approx(share, abs=1e-12)


def test_it_is_safe_until_the_first_write(sink):
    assert sink.share == pytest.approx(SAFE)


@pytest.mark.parametrize("command", [2, 128, 129, 130])
def test_leaving_operational_is_safe_until_a_new_write(sink, command):
    send(sink, 10100)
    sink.tick()
    sink.nmt(command)
    sink.tick(3)
    assert sink.share == pytest.approx(SAFE)
    sink.nmt(sink.START)
    sink.tick(3)
    assert sink.share == pytest.approx(SAFE)
    send(sink, 2100)
    sink.tick()
    assert sink.share == pytest.approx(0.1)


def test_a_stop_and_a_start_in_one_tick_are_heard(sink):
    send(sink, 10100)
    sink.tick()
    sink.nmt(sink.STOP)
    sink.nmt(sink.START)
    sink.tick()
    assert sink.share == pytest.approx(SAFE)


def test_a_write_after_stop_and_start_in_one_tick_counts(sink):
    send(sink, 10100)
    sink.tick()
    sink.nmt(sink.STOP)
    sink.nmt(sink.START)
    send(sink, 2100)
    sink.tick()
    assert sink.share == pytest.approx(0.1)


def test_a_write_by_sdo_before_the_start_acts_with_it(sink):
    sink.nmt(sink.PRE_OPERATIONAL)
    sink.tick()
    assert sink.write(0x6411, 1, 10100, 2) is None
    sink.tick()
    assert sink.share == pytest.approx(SAFE)
    sink.nmt(sink.START)
    sink.tick()
    assert sink.share == pytest.approx(0.5)


def test_a_missed_deadline_is_safe_until_the_next_rpdo(sink):
    assert sink.write(0x1401, 5, 20, 2) is None  # event timer [ms]
    send(sink, 10100)
    sink.tick(19)
    assert sink.share == pytest.approx(0.5)
    sink.tick(2)
    assert sink.share == pytest.approx(SAFE)
    assert sink.emcy_codes() == [0x8250]
    send(sink, 10100)
    sink.tick()
    assert sink.share == pytest.approx(0.5)


def test_no_number_is_safe(rig):
    variable = Variable(0x2000, 0, "set-point", REAL32)
    watch = CommandWatch(rig.node)
    sink = SpoolSink(watch, variable, scale=1.0, offset=0.0, safe=SAFE, full_opening=FULL_OPENING)
    rig.nmt(rig.START)
    for value, share in ((math.nan, SAFE), (math.inf, 1.0), (-1e30, -1.0), (0.25, 0.25)):
        variable.write(value)
        assert sink.command(rig.now) == pytest.approx(share * FULL_OPENING)


def test_two_sinks_of_one_node_are_told_of_the_same_interruption(rig):
    watch = CommandWatch(rig.node)
    sinks = [
        SpoolSink(
            *(watch, rig.object_dictionary.variable(0x6411, subindex)),
            scale=20000.0,
            offset=0.0,
            safe=0.0,
            full_opening=1.0,
        )
        for subindex in (1, 2)
    ]
    rig.nmt(rig.START)
    rig.receive(0x305, 0x10, 0x27, 0x10, 0x27)  # 10000 twice
    assert [sink.command(rig.now) for sink in sinks] == [0.5, 0.5]
    rig.nmt(rig.STOP)
    rig.nmt(rig.START)
    assert [sink.command(rig.now) for sink in sinks] == [0.0, 0.0]
