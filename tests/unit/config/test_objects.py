"""`[nodes.NAME.objects]`: other power-on values than those of the EDS file."""

import json

import pytest
from support.tables import from_text

from hil_bench import ConfigError, load_config
from hil_bench.bench.assembly import build_node
from hil_bench.canopen_device.frame import Frame
from hil_bench.cli import main

VALVE = '[nodes.valve]\nprofile = "valve_408"\nnode_id = 5\n'
SENSOR = '[nodes.p]\nprofile = "pressure_404"\nnode_id = 6\nsource = "P_A"\n'


def build(path, node=0):
    return build_node(load_config(path).nodes[node])


def number(dictionary, index, subindex=0):
    return dictionary.number(index, subindex)


@pytest.mark.parametrize(
    ("line", "index", "subindex", "value"),
    [
        ('"0x1400.05" = 100', 0x1400, 5, 100),
        ('"0X1400.5" = 100', 0x1400, 5, 100),
        ('"0x6042" = 2', 0x6042, 0, 2),
        ('"0x6314.01" = -1638', 0x6314, 1, -1638),
        ('"0x6314.01" = "0xF000"', 0x6314, 1, -4096),  # the bit pattern, as in an EDS
        ('"0x1018.02" = 0x1234', 0x1018, 2, 0x1234),  # read only to the bus
        ('"0x1008" = "my valve"', 0x1008, 0, "my valve"),
        ('"0x1400.01" = "$NODEID+0x300"', 0x1400, 1, 0x305),
    ],
)
def test_a_value_is_there_at_power_on(write, line, index, subindex, value):
    dictionary = build(write(f"{VALVE}[nodes.valve.objects]\n{line}")).object_dictionary

    variable = dictionary.variable(index, subindex)
    assert (variable.value, variable.default) == (value, value)


@pytest.mark.parametrize("command", [129, 130])
def test_an_nmt_reset_brings_it_back(write, command):
    node = build(write(f'{VALVE}objects = {{ "0x1400.05" = 100 }}'))
    node.start(0)
    node.serve(0, lambda _frame: None)
    node.object_dictionary.download(0x1400, 5, b"\x07\x00")
    assert number(node.object_dictionary, 0x1400, 5) == 7

    node.receive(Frame(0x000, bytes([command, 5])), 0)

    assert number(node.object_dictionary, 0x1400, 5) == 100


def test_a_number_stays_and_a_text_with_node_id_follows_it(write):
    objects = '{ "0x1400.01" = "$NODEID+0x300", "0x1800.01" = 0x40000333 }'
    dictionary = build(write(f"{VALVE}objects = {objects}")).object_dictionary

    dictionary.assign_node_id(9)

    assert dictionary.variable(0x1400, 1).default == 0x309
    assert dictionary.variable(0x1800, 1).default == 0x40000333


def test_a_node_without_node_id_follows_the_one_it_gets(write):
    valve = '[nodes.valve]\nprofile = "valve_408"\nnode_id = 255\nserial_number = 1\n'
    node = build(write(valve + 'objects = { "0x1400.01" = "$NODEID+0x300" }'))

    node.object_dictionary.assign_node_id(9)

    assert node.object_dictionary.variable(0x1400, 1).default == 0x309


def test_real_numbers(write):
    text = VALVE + SENSOR + '[nodes.p.objects]\n"0x6127.01" = 1.5\n"0x6126.01" = 2'
    dictionary = build(write(text), 1).object_dictionary

    assert dictionary.variable(0x6127, 1).default == 1.5
    assert dictionary.variable(0x6126, 1).default == 2.0


def test_a_mapping_can_be_another_one(write):
    objects = '"0x1A00.00" = 1\n"0x1A00.01" = 0x61500108'
    config = load_config(write(f"{VALVE}{SENSOR}[nodes.p.objects]\n{objects}"))

    assert config.nodes[1].objects == {(0x1A00, 0): 1, (0x1A00, 1): 0x61500108}
    assert config.nodes[0].objects == {}
    build_node(config.nodes[1])


@from_text("objects", "message")
def test_what_is_wrong_in_the_file_is_told_with_its_place(write, objects, message):
    path = write(f"{VALVE}[nodes.valve.objects]\n{objects}")

    with pytest.raises(ConfigError) as caught:
        load_config(path)

    assert str(caught.value) == f"{path}:nodes.valve.objects: {message}"


def test_objects_that_are_no_table(write):
    with pytest.raises(
        ConfigError, match=r"objects: 5 is not a table; give objects and values, as"
    ):
        load_config(write(f"{VALVE}objects = 5"))


@pytest.mark.parametrize(
    ("objects", "message"),
    [
        ('"0x1400.05" = 65536', "0x1400.05: '65536' is outside UNSIGNED16; write 0 to 65535"),
        ('"0x1400.05" = 1.5', "0x1400.05: '1.5' is no number; write 384, 0x180 or $NODEID+0x180"),
        ('"0x6042" = 3', "0x6042.00: 3 is out of range; give 1 to 2"),
        ('"0x6343.01" = -1', "0x6343.01: -1 is out of range; give 0 to any"),
        ('"0x1A00.01" = 0x60420010', "0x1A00.01: maps 0x6042.00 "),
    ],
)
def test_what_the_eds_does_not_allow_is_told_when_the_device_is_made(write, objects, message):
    with pytest.raises(ConfigError) as caught:
        build(write(f"{VALVE}[nodes.valve.objects]\n{objects}"))

    assert str(caught.value).startswith(f"bench.toml:nodes.valve.objects.{message}")
    assert "\n" not in str(caught.value)


def test_an_object_that_is_not_there(write):
    with pytest.raises(ConfigError) as caught:
        build(write(f'{VALVE}objects = {{ "0x2000" = 1 }}'))

    assert str(caught.value).startswith("bench.toml:nodes.valve.objects.0x2000.00: is not in ")
    assert str(caught.value).endswith('valve_408.eds; the nearest is 0x1F80.00, "NMT startup"')


def test_check_prints_a_table_that_loads_again(write, make_file, cli):
    objects = '{ "0x1400.05" = 100, "0x1008" = "a \\"valve\\"" }'
    path = write(f"{VALVE}objects = {objects}")

    again = make_file("again.toml", cli(["check", str(path)]).out)
    assert load_config(again).nodes[0].objects == {(0x1400, 5): 100, (0x1008, 0): 'a "valve"'}


def test_devices_shows_the_pdos_that_are_in_force(write, cli):
    path = write(f'{VALVE}objects = {{ "0x1800.05" = 3, "0x1400.01" = "$NODEID+0x300" }}')

    rpdo, tpdo = json.loads(cli(["devices", str(path), "--json"]).out)[0]["pdos"]
    assert (rpdo["can_id"], tpdo["event_time_ms"]) == (0x305, 3)


def test_check_refuses_what_the_eds_does_not_allow(write, capsys):
    assert main(["check", str(write(f'{VALVE}objects = {{ "0x6042" = 3 }}'))]) == 2
    assert "nodes.valve.objects.0x6042.00: 3 is out of range" in capsys.readouterr().err
