"""Whatever a file holds, it is a bench or a `ConfigError`."""

import datetime as dt
import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from device_profiles import VALVE_408
from hil_bench.abilities.faults.registry import COMMON_KEYS, FAULT_KINDS
from hil_bench.bench.configuration import load, load_config
from hil_bench.bench.configuration.loop import (
    BENCH_KEYS,
    BUS_KEYS,
    SINK_KEYS,
    SOURCE_KEYS,
    node_keys,
)
from hil_bench.devices.kinds.bindings import CHAIN_KEYS
from hil_bench.devices.kinds.registry import KINDS
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.keys import AXIS_KEYS

TEXT = st.text(alphabet='aZ_-.\n\x00\u2028é\\"', max_size=4)
SCALARS = (
    st.sampled_from([0, 1, -1, 0.5, 1e-300, 1e300, 100, 127, True, False, 10**400])
    | st.sampled_from(["valve_408", "pressure_404", "encoder_406", "P_A", "axis1", "forward-euler"])
    | st.sampled_from([math.nan, math.inf, dt.date(2026, 11, 21), dt.time(1, 2)])
    | st.integers()
    | TEXT
)
VALUES = SCALARS | st.lists(SCALARS, max_size=2) | st.dictionaries(TEXT, SCALARS, max_size=1)


def table(*keys):
    names = st.sampled_from([key.name for key in keys]) | TEXT
    return st.dictionaries(names, VALUES, max_size=8)


BINDING = st.dictionaries(
    st.sampled_from([*(key.name for keys in (SOURCE_KEYS, SINK_KEYS) for key in keys), "chain"]),
    VALUES | st.sampled_from(["axis1.P_A", "axis1.spool_setpoint", "b.speed", "bar", "%"]),
    max_size=4,
)
OBJECTS = st.dictionaries(st.sampled_from(["0x6401.01", "0x2000", "0x1017"]), BINDING | VALUES)
GENERIC = st.fixed_dictionaries(
    {"node_id": st.just(10), "eds": st.sampled_from([str(VALVE_408), "none.eds"])},
    optional={"objects": OBJECTS, "profile": VALUES},
)
CHAIN = table(*{key.name: key for keys in CHAIN_KEYS.values() for key in keys}.values())
SENSOR = st.fixed_dictionaries(
    {
        "node_id": st.integers(1, 9),
        "profile": st.sampled_from(["pressure_404", "encoder_406", "valve_408"]),
        "chain": CHAIN | VALUES,
    },
    optional={"source": st.just("P_A")},
)
NODE_TABLE = table(
    *{key.name: key for kind in KINDS.built_in.values() for key in node_keys(kind)}.values()
)
NODE = GENERIC | SENSOR | NODE_TABLE
FAULT = st.fixed_dictionaries(
    {
        "kind": st.sampled_from([*FAULT_KINDS.built_in]),
        "target": st.sampled_from(["v", "w", "axis1", "v.0x6401.01"]),
    },
    optional={
        key.name: VALUES
        for keys in (COMMON_KEYS[2:], *(kind.keys for kind in FAULT_KINDS.built_in.values()))
        for key in keys
    },
)
DOCUMENTS = st.fixed_dictionaries(
    {},
    optional={
        "bench": table(*BENCH_KEYS) | VALUES,
        "bus": table(*BUS_KEYS) | VALUES,
        "plant": st.dictionaries(st.sampled_from(["axis1", "b", "\n"]), table(*AXIS_KEYS)) | VALUES,
        "nodes": st.dictionaries(st.sampled_from(["v", "w", "\n"]), NODE) | VALUES,
        "faults": st.lists(FAULT | VALUES, max_size=3) | VALUES,
        "other": VALUES,
    },
)


def message_of(action):
    """The message of the `ConfigError`, empty where there is a bench."""
    try:
        assert action().nodes
    except ConfigError as error:
        return str(error)
    return ""


@settings(suppress_health_check=[HealthCheck.too_slow])  # the machine may be busy
@given(document=DOCUMENTS)
def test_any_toml_is_a_bench_or_a_config_error(document):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(load, "read_document", lambda _path, _wanted: document)
        message = message_of(lambda: load_config("bench.toml"))

    for line in filter(None, message.split("\n")):
        assert line.startswith("bench.toml:")
        assert line.isprintable()


@given(content=st.binary(max_size=40) | st.text(max_size=40).map(str.encode))
def test_any_file_is_a_bench_or_a_config_error(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("config") / "bench.toml"
    path.write_bytes(content)
    message = message_of(lambda: load_config(path))

    assert message.startswith(str(path) if message else "")
