"""A device sends once a tick at most, so it refuses to be asked for a shorter period.

The abort is 0609 0030, invalid value for parameter (CiA 301).
"""

import logging

import pytest
from support.bus_side import POSITION, VALVE, BusSide

from device_profiles import IMITATIONS
from hil_bench import ConfigError, load_config
from hil_bench.bench.assembly import build_bench

REFUSED = bytes.fromhex("30000906")
CYCLE, HEARTBEAT, EVENT_TIMER, SYNC_ID = (0x1006, 0), (0x1017, 0), (0x1800, 5), (0x1005, 0)
LENGTHS = {CYCLE: 4, HEARTBEAT: 2, EVENT_TIMER: 2, SYNC_ID: 4, (0x6200, 0): 2}


@pytest.fixture
def make_bench(load_bench):
    def make(tick_us=1000, more=""):
        return BusSide(load_bench(f"[bench]\ntick_us = {tick_us}\nstep_us = 100\n{more}"))

    return make


def write(bus, node_id, key, value):
    """Write an object by SDO; return the abort code as it stands on the bus, None for none."""
    answer = bus.download(node_id, *key, value.to_bytes(LENGTHS[key], "little"))
    return answer[4:] if answer[0] == 0x80 else None


@pytest.mark.parametrize(
    ("tick_us", "key", "shortest"),
    [
        (1000, CYCLE, 1000),  # us
        (100, CYCLE, 100),
        (2500, CYCLE, 2500),
        (2500, HEARTBEAT, 3),  # ms: 2 would be less than the 2.5 of the tick
        (2500, EVENT_TIMER, 3),
        (2500, (0x6200, 0), 3),  # the cyclic timer is the event timer (CiA 406)
        (10_000, HEARTBEAT, 10),
        (10_000, EVENT_TIMER, 10),
    ],
)
def test_the_shortest_period_is_a_tick(make_bench, tick_us, key, shortest):
    bus = make_bench(tick_us)
    bus.tick()
    assert write(bus, POSITION, key, shortest - 1) == REFUSED
    assert write(bus, POSITION, key, 1) == REFUSED
    assert write(bus, POSITION, key, shortest) is None
    assert write(bus, POSITION, key, shortest - 1) == REFUSED  # the old one stays
    index, subindex = key
    assert bus.bench.nodes[3].object_dictionary.number(index, subindex) == shortest
    assert write(bus, POSITION, key, 0) is None  # off


@pytest.mark.parametrize("key", [HEARTBEAT, EVENT_TIMER])
def test_a_millisecond_is_no_shorter_than_a_tick_of_one(make_bench, key):
    bus = make_bench()
    bus.tick()
    assert write(bus, VALVE, key, 1) is None


def test_what_is_accepted_is_kept(make_bench):
    bus = make_bench()
    bus.tick()
    assert write(bus, VALVE, CYCLE, 1000) is None
    assert write(bus, VALVE, SYNC_ID, 0x40000080) is None
    assert [len([f for f in bus.tick() if f.can_id == 0x80]) for _ in range(20)] == [1] * 20


def test_time_outs_and_inhibit_times_are_lower_bounds_and_may_be_short(make_bench):
    bus = make_bench(10_000)
    bus.tick()
    assert bus.download(VALVE, 0x1400, 5, b"\x01\x00")[0] == 0x60  # RPDO time-out: 1 ms
    assert bus.download(VALVE, 0x1016, 1, (0x7F << 16 | 1).to_bytes(4, "little"))[0] == 0x60
    assert bus.download(VALVE, 0x1007, 0, (100).to_bytes(4, "little"))[0] == 0x60  # window: 0.1 ms


def test_a_period_of_the_configuration_is_an_error(make_bench):
    more = (
        '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n'
        'objects = { "0x1006" = 500, "0x1005" = 0x40000080 }\n'
    )
    with pytest.raises(ConfigError) as caught:
        make_bench(more=more)
    assert str(caught.value).endswith(
        'bench.toml:nodes.valve.objects: 0x1006.00 "Communication cycle period" is 500, shorter '
        "than a tick of 1000 us; give a longer one, 0 for none, or a shorter tick_us"
    )


def test_a_period_of_the_eds_file_is_told(tmp_path, caplog):
    path = tmp_path / "bench.toml"
    eds = IMITATIONS / "analogue_io_401.eds"
    path.write_text(
        f'[bench]\ntick_us = 20000\nstep_us = 100\n[nodes.io]\nnode_id = 10\neds = "{eds}"\n'
    )
    with caplog.at_level(logging.WARNING):
        build_bench(load_config(path))
    (message,) = caplog.messages
    what = '0x1801.05 "Event timer" is 10, shorter than a tick of 20000 us: it will be each tick'
    assert message == f"{path}:nodes.io: {what}"
