# ruff: noqa: E501 - a mistake and its message on one line are easier to compare
"""Bindings in `[nodes.NAME.objects]`, and devices made from an EDS file alone."""

import json
from pathlib import Path

import pytest
from support.tables import from_text

from device_profiles import IMITATIONS
from hil_bench import ConfigError, load_config
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.power_on import load_objects
from hil_bench.cli import main
from hil_bench.devices.kinds.kind import GenericConfig

EDS = IMITATIONS / "analogue_io_401.eds"
IO = f'[nodes.io]\nnode_id = 10\neds = "{EDS}"\n'
OBJECTS = "[nodes.io.objects]\n"
SINK = '"0x6411.01" = { sink = "axis1.spool_setpoint" }\n'
VALVE = '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n'


def io_node(path):
    (node,) = (node for node in load_config(path).nodes if isinstance(node, GenericConfig))
    return node


def test_an_eds_without_a_profile_is_a_generic_device(write):
    node = io_node(write(VALVE + IO))

    assert (node.profile, node.axis, node.node_id, node.eds) == ("generic", None, 10, EDS)
    assert (node.sources, node.sinks, node.objects) == ((), (), {})


def test_a_source(write):
    binding = '{ source = "axis1.P_A", unit = "bar", scale = 100, offset = 4, delta = 0 }'
    (source,) = io_node(write(f'{VALVE}{IO}{OBJECTS}"0x6401.2" = {binding}')).sources

    assert (source.index, source.subindex, source.name) == (0x6401, 2, "0x6401.02")
    assert (source.axis, source.quantity) == ("axis1", "P_A")
    assert source.scale == pytest.approx(1e-3)  # 100 increments for 1e5 Pa
    assert (source.offset, source.delta) == (4.0, 0.0)


def test_a_sink(write):
    plant = "[plant.b]\norifice_full_opening_negative_mm = 2.0\n"
    binding = '{ sink = "b.spool_setpoint", unit = "%", scale = 327.67, safe = -5 }'
    node = io_node(write(f'{plant}{IO}{OBJECTS}"0x6411.01" = {binding}'))

    (sink,) = node.sinks
    assert (sink.axis, sink.quantity) == ("b", "spool_setpoint")
    assert sink.scale == pytest.approx(32767.0)  # increments for 100 %
    assert (sink.offset, sink.safe) == (0.0, pytest.approx(-0.05))
    assert sink.full_opening == pytest.approx(2.3e-3)  # the larger side, with 0.3 mm of overlap
    assert node.bindings == (sink,)


def test_what_is_not_given_is_si(write):
    path = write(f'{IO}{OBJECTS}{SINK}"0x6401.01" = {{ source = "axis1.P_A" }}')
    node = io_node(path)

    (source,), (sink,) = node.sources, node.sinks
    assert (source.scale, source.offset, source.delta) == (1.0, 0.0, None)
    assert (sink.scale, sink.offset, sink.safe) == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("quantity", "unit", "factor"),
    [
        *(("position", "m", 1.0), ("position", "mm", 1e-3), ("speed", "mm/s", 1e-3)),
        *(("P_B", "Pa", 1.0), ("P_B", "MPa", 1e6), ("Q_A", "m³/s", 1.0)),
        *(("Q_B", "l/min", 1e-3 / 60.0), ("spool_position", "%", 0.01)),
    ],
)
def test_units(write, quantity, unit, factor):
    binding = f'{{ source = "axis1.{quantity}", unit = "{unit}", scale = 3 }}'
    (source,) = io_node(write(f'{VALVE}{IO}{OBJECTS}"0x6401.01" = {binding}')).sources

    assert source.scale * factor == pytest.approx(3.0)


def test_a_device_with_a_profile_may_have_sources(write):
    objects = '[nodes.valve.objects]\n"0x6310.01" = { source = "axis1.P_A" }\n"0x6314.01" = 5'
    (valve,) = load_config(write(VALVE + objects)).nodes

    assert [source.name for source in valve.sources] == ["0x6310.01"]
    assert valve.objects == {(0x6314, 1): 5}


BOUND = "nodes.io.objects.0x6401.01"

IN_THE_FILE = [
    # The binding itself
    ('"0x6401.01" = { scale = 2 }', f'{BOUND}: is bound to nothing; give source = "AXIS.P_A" or sink = "AXIS.spool_setpoint", or a script: constant, ramp, sine, table, follow'),
    ('"0x6401.01" = { source = "axis1.P_A", sink = "axis1.u" }', f'{BOUND}: is both a source and a sink; give source = "AXIS.P_A" or sink = "AXIS.spool_setpoint"'),
    ('"0x1017" = { source = "axis1.P_A" }', "nodes.io.objects.0x1017.00: belongs to the communication services; bind an object from 0x2000 up"),
    ('"0x6401.01" = { source = "axis1.P_A", factor = 2 }', f"{BOUND}.factor: unknown key; the nearest known key is source"),
    ('"0x6401.01" = { source = "axis1.P_A", safe = 2 }', f"{BOUND}.safe: unknown key; the nearest known key is scale"),
    ('"0x6411.01" = { sink = "axis1.spool_setpoint", delta = 2 }', "nodes.io.objects.0x6411.01.delta: unknown key; the nearest known key is offset"),
    # Names
    ('"0x6401.01" = { source = 5 }', f"{BOUND}.source: 5 is not a name; give text in quotes"),
    ('"0x6401.01" = { source = "axis1.P_C" }', f'{BOUND}.source: "axis1.P_C" can be no source; the nearest that can is "axis1.P_B"'),
    ('"0x6401.01" = { source = "axis1.spool_setpoint" }', f'{BOUND}.source: "axis1.spool_setpoint" can be no source; the nearest that can is "axis1.spool_position"'),
    ('"0x6401.01" = { source = "axs1.positio" }', f'{BOUND}.source: "axs1.positio" names no axis of the bench; the nearest that can is "axis1.position"'),
    ('"0x6401.01" = { source = "P_A" }', f'{BOUND}.source: "P_A" names no axis of the bench; the nearest that can is "axis1.P_A"'),
    ('"0x6401.01" = { source = "axis1.P_A", unit = "psi" }', f'{BOUND}.unit: "psi" is no unit of P_A; give one of "Pa", "mbar", "kPa", "bar", "MPa"'),
    ('"0x6411.01" = { sink = "axis1.P_A" }', 'nodes.io.objects.0x6411.01.sink: "axis1.P_A" can be no sink; the nearest that can is "axis1.spool_setpoint"'),
    # Numbers
    ('"0x6401.01" = { source = "axis1.P_A", scale = 0 }', f"{BOUND}.scale: 0 would lose the quantity; give a number other than 0"),
    ('"0x6401.01" = { source = "axis1.P_A", scale = "1" }', f'{BOUND}.scale: "1" is not a number; give a number other than 0'),
    ('"0x6401.01" = { source = "axis1.P_A", offset = nan }', f"{BOUND}.offset: nan is not finite; give a number"),
    ('"0x6401.01" = { source = "axis1.P_A", delta = -1 }', f"{BOUND}.delta: -1 is out of range; give a number, 0 or more"),
]  # fmt: skip

TOGETHER = [
    (f'{IO}{OBJECTS}{SINK}"0x6411.02" = {{ sink = "axis1.spool_setpoint" }}', "nodes.io.objects.0x6411.02.sink: axis1 has the sink bench.toml:nodes.io.objects.0x6411.01 already; give each axis one valve or one sink"),
    (f"{VALVE}{IO}{OBJECTS}{SINK}", "nodes.io.objects.0x6411.01.sink: axis1 has the valve nodes.valve already; give each axis one valve or one sink"),
    (f"{VALVE}[nodes.valve.objects]\n{SINK}", "nodes.valve.objects.0x6411.01.sink: nodes.valve does what its profile says; give the sink to a node without a profile"),
    (f"{IO}[plant.axis1]\n", 'plant.axis1: has no valve; give it a node with profile = "valve_408" and axis = "axis1", or bind an object with sink = "axis1.spool_setpoint"'),
    ('[nodes.io]\nprofile = "generic"\nnode_id = 1', 'nodes.io.eds: missing; give for example eds = "vendor.eds"'),
    (f'{IO}axis = "axis1"', "nodes.io.axis: unknown key; the nearest known key is eds"),
]  # fmt: skip


def test_devices_that_nothing_binds_to_the_plant_need_no_axis(write):
    config = load_config(write(f"{IO}{OBJECTS}'0x6401.01' = 5\n"))
    assert config.axes == ()
    assert [node.axis for node in config.nodes] == [None]


def test_a_single_binding_brings_the_default_axis(write):
    config = load_config(write(f"{IO}{OBJECTS}{SINK}"))
    assert [axis.name for axis in config.axes] == ["axis1"]


@pytest.mark.parametrize(
    ("text", "message"),
    [(f"{VALVE}{IO}{OBJECTS}{line}", message) for line, message in IN_THE_FILE] + TOGETHER,
)
def test_a_mistake_is_told_in_one_line(write, text, message):
    with pytest.raises(ConfigError) as caught:
        load_config(write(text))

    assert str(caught.value).splitlines()[0] == f"bench.toml:{message}"
    # A sink on a device with a profile is a second commander of its axis too.
    assert len(str(caught.value).splitlines()) == 1 + ("profile says" in message)


@from_text("line", "message")
def test_what_the_eds_does_not_allow_is_told_with_file_and_key(write, capsys, line, message):
    axes = '[plant.axis1]\n[plant.b]\n[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n'
    spare = "" if "sink" in line else '"0x6411.01" = { sink = "b.spool_setpoint" }\n'
    path = write(f'{axes}axis = "axis1"\n{IO}{OBJECTS}{spare}{line}')

    assert main(["check", str(path)]) == 2
    expected = f"hil-bench: error: bench.toml:nodes.io.objects.{message}\n"
    assert capsys.readouterr().err == expected


@pytest.mark.parametrize(
    ("data_type", "kind"), [("0x0001", "BOOLEAN"), ("0x0009", "VISIBLE_STRING")]
)
def test_an_object_that_is_no_number(write, data_type, kind):
    text = EDS.read_text(encoding="ascii")
    for section, was, new in (
        ("6401sub4", "0x0003", data_type),
        ("1A01sub0", "Value=4", "Value=3"),
    ):
        head, entry = text.split(f"[{section}]")
        text = f"{head}[{section}]{entry.replace(was, new, 1)}"
    Path("own.eds").write_text(text, encoding="ascii")
    objects = '"0x6401.04" = { source = "axis1.P_A" }'
    node = io_node(write(f"{VALVE}{IO.replace(str(EDS), 'own.eds')}{OBJECTS}{objects}"))

    right = "bind an object of an INTEGER, UNSIGNED or REAL type"
    with pytest.raises(ConfigError) as caught:
        load_objects(node)
    assert str(caught.value) == (
        f'bench.toml:nodes.io.objects.0x6401.04: "Analogue input 4" is {kind}; {right}'
    )


def test_objects_and_eds_files_of_several_nodes_are_told_together(write, cli):
    bad = '"0x6401.09" = { source = "axis1.P_A" }'
    path = write(f'{VALVE}objects = {{ "0x6042" = 3 }}\n{IO}{OBJECTS}{bad}')

    lines = cli(["check", str(path)], 2).err.splitlines()
    assert [line.split(": ")[2] for line in lines] == [
        "bench.toml:nodes.valve.objects.0x6042.00",
        "bench.toml:nodes.io.objects.0x6401.09",
    ]


def test_check_prints_bindings_that_load_again(write, make_file, cli):
    binding = '{ source = "axis1.P_A", unit = "bar", scale = 2.5 }'
    path = write(f'{IO}{OBJECTS}{SINK}"0x6401.01" = {binding}\n"0x1801.05" = 7')

    again = make_file("again.toml", cli(["check", str(path)]).out)
    assert load_config(again).nodes == load_config(path).nodes


def test_devices_shows_what_is_bound(write, cli):
    path = write(f'{IO}{OBJECTS}{SINK}"0x6401.01" = {{ source = "axis1.P_A" }}')

    text = " ".join(cli(["devices", str(path)]).out.split())
    assert "node 10 io generic EDS" in text
    assert "source 0x6401.01 <- axis1.P_A Analogue input 1 (INTEGER16)" in text
    assert "sink 0x6411.01 -> axis1.spool_setpoint Analogue output 1 (INTEGER16)" in text

    (device,) = json.loads(cli(["devices", str(path), "--json"]).out)
    assert device["axis"] is None
    assert [bound["role"] for bound in device["bound"]] == ["source", "sink"]


def test_a_source_on_a_device_with_a_profile_wins(write):
    objects = '[nodes.valve.objects]\n"0x6350.01" = { source = "axis1.P_A", unit = "bar" }'
    bench = build_bench(load_config(write(VALVE + objects)))

    bench.start(0)
    bench.tick([], 1_000_000)

    # The balanced cylinder of Table I: 50 bar * A_B / A = 50 * 47 / 48.5 = 48.45 bar.
    assert bench.nodes[0].object_dictionary.number(0x6350, 1) == 48
