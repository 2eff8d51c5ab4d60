"""Where a value comes from: the command line before the environment, the file, the default."""

from collections.abc import Callable
from pathlib import Path

import pytest

from hil_bench.bench.configuration import (
    BusConfig,
    Origin,
    OverrunPolicy,
    RealtimeConfig,
    RealtimePolicy,
    load_config,
)
from hil_bench.errors import ConfigError

Write = Callable[[str], Path]


def origin(config, table, key):
    return next(s.origin for s in config.settings if (s.table, s.key.name) == (table, key))


def test_another_interface_on_the_command_line_lets_the_files_options_lapse(write):
    path = write('[bus]\ninterface = "socketcand"\nhost = "127.0.0.1"\nbitrate = 250000\n')
    bus = load_config(
        path, interface="socketcan", channel="can0", bus_options={"receive_own_messages": True}
    ).bus

    assert bus == BusConfig("socketcan", "can0", 250000, {"receive_own_messages": True})


def test_the_command_line_wins_over_environment_file_and_default(write, monkeypatch):
    path = write("[bench]\nseed = 2\n")
    found = [(load_config().seed, origin(load_config(), "bench", "seed"))]
    found.append((load_config(path).seed, origin(load_config(path), "bench", "seed")))
    monkeypatch.setenv("HIL_BENCH_SEED", "3")
    found.append((load_config(path).seed, origin(load_config(path), "bench", "seed")))
    config = load_config(path, seed=4)
    found.append((config.seed, origin(config, "bench", "seed")))

    assert found == [
        (1, Origin.DEFAULT),
        (2, Origin.FILE),
        (3, Origin.ENVIRONMENT),
        (4, Origin.COMMAND_LINE),
    ]


def test_the_environment_names_the_file_where_nobody_else_does(write, make_file, monkeypatch):
    path = write("[bench]\nseed = 2\n")
    other = make_file("other.toml", "[bench]\nseed = 5\n")
    monkeypatch.setenv("HIL_BENCH_CONFIG", str(path))

    assert load_config().path == path
    assert load_config().seed == 2
    assert load_config(str(other)).seed == 5


def test_empty_variables_count_as_absent(monkeypatch):
    monkeypatch.setenv("HIL_BENCH_CONFIG", "")
    monkeypatch.setenv("HIL_BENCH_SEED", "")

    assert load_config() == load_config()
    assert load_config().path is None
    assert load_config().seed == 1


def test_each_value_knows_its_origin(write):
    config = load_config(write("[plant.axis1]\nstroke_mm = 300\n"), channel="vcan0")

    assert origin(config, "plant.axis1", "stroke_mm") is Origin.FILE
    assert origin(config, "plant.axis1", "moving_mass_kg") is Origin.DEFAULT
    assert origin(config, "bus", "channel") is Origin.COMMAND_LINE
    assert origin(config, "bus", "interface") is Origin.DEFAULT


def test_the_command_line_says_how_the_loop_runs(write):
    path = write('[bench]\nrealtime = "fifo"\noverrun = "skip"\n')
    config = load_config(path, loop={"realtime_cpu": 3, "overrun": "stop", "realtime": None})

    assert config.realtime == RealtimeConfig(
        policy=RealtimePolicy.FIFO, priority=80, cpu=3, overrun=OverrunPolicy.STOP
    )
    assert load_config().realtime == RealtimeConfig()


def test_a_wrong_option_is_named_as_an_option():
    with pytest.raises(ConfigError, match=r"^--realtime-priority: 99 is out of range; give an int"):
        load_config(loop={"realtime_priority": 99})
