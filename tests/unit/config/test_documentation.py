"""The documentation and the examples say what the code does."""

import json
import re
import tomllib
from pathlib import Path

import pytest

from hil_bench import ConfigError, load_config
from hil_bench.abilities.copper.section import WIRE_KEYS
from hil_bench.abilities.faults.registry import COMMON_KEYS, FAULT_KINDS
from hil_bench.abilities.faults.section import FaultsPart
from hil_bench.abilities.modbus.map_files import ModbusConfig
from hil_bench.abilities.modbus.section import MODBUS_KEYS, UNIT_KEYS
from hil_bench.bench.assembly import build_node
from hil_bench.bench.configuration.axes import KIND_KEY
from hil_bench.bench.configuration.bindings import SCRIPT_KEYS
from hil_bench.bench.configuration.loop import (
    BENCH_KEYS,
    BUS_KEYS,
    SINK_KEYS,
    SOURCE_KEYS,
    node_keys,
)
from hil_bench.devices.kinds.bindings import CHAIN_KEYS
from hil_bench.devices.kinds.registry import KINDS
from hil_bench.plants.hydraulic_cylinder.keys import AXIS_KEYS, TANK_KEYS

ROOT = Path(__file__).parents[3]
DOCUMENT = (ROOT / "docs" / "configuration.md").read_text(encoding="utf-8")
TABLES = (
    BENCH_KEYS,
    BUS_KEYS,
    WIRE_KEYS,
    AXIS_KEYS,
    (KIND_KEY,),
    tuple(key for key in TANK_KEYS if key.name != "oil"),  # as that of an axis
    *map(node_keys, reversed(KINDS.built_in.values())),
    SOURCE_KEYS,
    SINK_KEYS,
    *SCRIPT_KEYS.values(),
    *CHAIN_KEYS.values(),
    COMMON_KEYS,
    *(kind.keys for kind in FAULT_KINDS.built_in.values()),
    MODBUS_KEYS,
    UNIT_KEYS,
)
ALL_KEYS = {key.name: key for keys in TABLES for key in keys}
ROWS = {
    name: (unit, default)
    for name, unit, default in re.findall(
        r"^\| `(\w+)` \| (.+?) \| (.+?) \|", DOCUMENT, re.MULTILINE
    )
}
WRONG = re.findall(r"```toml\n([^`]*)```\n\n```text\n([^`]*)```", DOCUMENT)
FAULTS = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8")
ACTIONS = (ROOT / "hil_bench/abilities/panel/static/fault_form.js").read_text(encoding="utf-8")
OBJECTS = re.findall(r"```toml\n(\[nodes\.valve\.objects\][^`]*)```", DOCUMENT)


def test_the_document_has_each_key_and_no_other():
    assert ROWS.keys() == ALL_KEYS.keys()


def test_the_document_has_the_unit_and_the_default_of_each_key():
    for key in ALL_KEYS.values():
        unit, default = ROWS[key.name]
        assert unit == ("bit/s" if key.name.endswith("bitrate") else key.unit.symbol), key
        if key.example:
            assert default == "must be given", key
        elif key.default is not None:
            assert default == f"`{json.dumps(key.default)}`", key
        else:
            assert not default.startswith("`"), key


def test_each_key_ends_in_the_suffix_of_its_unit():
    assert [key for key in ALL_KEYS.values() if not key.name.endswith(key.unit.suffix)] == []


@pytest.mark.parametrize(("text", "messages"), WRONG)
def test_the_messages_in_the_document_are_the_real_ones(write, text, messages):
    with pytest.raises(ConfigError) as caught:
        load_config(write(text))

    assert str(caught.value) == messages.strip()


def test_the_document_shows_messages():
    assert len(WRONG) == 4


def test_the_objects_in_the_document_can_be_overridden(write):
    (text,) = OBJECTS
    valve = '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n'

    dictionary = build_node(load_config(write(valve + text)).nodes[0]).object_dictionary

    assert dictionary.number(0x1400, 5) == 100
    assert dictionary.number(0x1800, 1) == 0x40000281


def test_the_example_of_one_axis_is_the_built_in_bench():
    example, default = load_config(ROOT / "examples" / "one_axis.toml"), load_config()

    assert (example.tick_ns, example.step_ns, example.seed) == (
        default.tick_ns,
        default.step_ns,
        default.seed,
    )
    assert (example.bus, example.axes, example.nodes) == (default.bus, default.axes, default.nodes)


def test_the_example_of_one_axis_has_every_key_of_the_plant():
    example = tomllib.loads((ROOT / "examples" / "one_axis.toml").read_text(encoding="utf-8"))

    assert example["bench"].keys() == {key.name for key in BENCH_KEYS} - {"realtime_cpu"}
    written = {key.name for key in AXIS_KEYS if key.default is not None}
    assert example["plant"]["axis1"].keys() == written
    text = (ROOT / "examples" / "one_axis.toml").read_text(encoding="utf-8")
    for key in (*BENCH_KEYS, *AXIS_KEYS):
        assert f"\n{key.name} = " in text or f"\n# {key.name} = " in text


@pytest.mark.parametrize(("node", "unit"), [("pressure_a", "Pa"), ("position", "m")])
def test_the_example_of_one_axis_has_every_key_of_a_chain(node, unit):
    text = (ROOT / "examples" / "one_axis.toml").read_text(encoding="utf-8")
    written = tomllib.loads(text)["nodes"][node]["chain"].keys()
    ranges = {key.name for key in CHAIN_KEYS[unit] if key.default is None}

    assert written | ranges == {key.name for key in CHAIN_KEYS[unit]}
    assert all(f"\n# {name} = " in text for name in ranges)


def test_the_example_of_faults_loads():
    config = load_config(ROOT / "examples" / "faults.toml")

    assert [fault.kind for fault in config.of(FaultsPart).faults] == [
        *("offset", "break_wire", "stick", "drop_supply", "lose", "reset", "leak", "bind")
    ]


def test_the_example_of_real_sensors_has_no_ideal_one():
    config = load_config(ROOT / "examples" / "real_sensors.toml")

    assert [node.chain.is_ideal for node in config.nodes[1:]] == [False] * 3


def test_the_example_of_sixteen_axes_has_64_nodes():
    config = load_config(ROOT / "examples" / "sixteen_axes.toml")

    assert len(config.axes) == 16
    assert sorted(node.node_id for node in config.nodes) == list(range(1, 65))


def test_the_example_of_two_axes_loads():
    config = load_config(ROOT / "examples" / "two_axes.toml")

    assert [axis.name for axis in config.axes] == ["feed", "press"]


def test_the_example_with_modbus_serves_all_devices():
    modbus = load_config(ROOT / "examples" / "modbus.toml").of(ModbusConfig)
    assert modbus is not None
    assert [(unit.node, unit.unit_id, unit.commands) for unit in modbus.units] == [
        ("valve", 1, True),
        ("pressure_a", 2, False),
        ("pressure_b", 30, False),
        ("position", 4, False),
    ]
    assert modbus.server.serial is not None
    assert modbus.server.serial.port == "pty"


def test_the_page_on_faults_and_the_panel_have_each_kind():
    for kind in FAULT_KINDS.built_in.values():
        row = re.search(rf"^\| `{kind.name}` \|.*\|$", FAULTS, re.MULTILINE)
        assert row is not None, kind
        assert [key.name for key in kind.keys if f"`{key.name}`" not in row[0]] == []
        assert re.search(rf"\b{kind.name}: \"", ACTIONS) is not None, kind
