"""The tables [modbus] and [modbus.units.NAME]."""

from pathlib import Path

import pytest
from support.tables import from_text

from device_profiles import REGISTERS
from hil_bench.abilities.modbus.map_files import ModbusConfig
from hil_bench.abilities.modbus.protocol.register_map import (
    Holes,
    Parity,
    RegisterAccess,
    SerialConfig,
    ServerConfig,
    Table,
    TlsConfig,
    WordOrder,
)
from hil_bench.bench.configuration import Origin, load_config
from hil_bench.errors import ConfigError


def load(path):
    config = load_config(path).of(ModbusConfig)
    assert config is not None
    return config


def problems(path):
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    return [line.removeprefix("bench.toml:") for line in str(caught.value).splitlines()]


def test_without_the_table_there_is_no_server():
    assert load_config().of(ModbusConfig) is None


def test_tables_that_nobody_would_read_are_refused():
    with pytest.raises(TypeError, match=r"^load_config\(\) takes True or False for 'modbus', not"):
        load_config(modbus=[{"port": 5021}])


@pytest.mark.parametrize("text", ["[modbus]\n", ""])
def test_the_sensors_are_its_units_by_default(write, text):
    config = load_config(write(text), modbus=True).of(ModbusConfig)
    assert config is not None
    units = [(unit.unit_id, unit.name, unit.node, unit.commands) for unit in config.units]
    assert units == [
        (2, "pressure_a", "pressure_a", False),
        (3, "pressure_b", "pressure_b", False),
        (4, "position", "position", False),
    ]
    assert config.server == ServerConfig(
        is_on_tcp=True, host="127.0.0.1", port=5020, connections=64, serial=None
    )


def test_the_files_of_tls_are_beside_the_configuration(write):
    path = write(
        """
        [modbus]
        tls_certificate = "server.pem"
        tls_key = "/etc/server.key"
        tls_client_ca = "ca.pem"
        tls_writer_role = "engineer"
        """
    )
    folder = path.parent
    assert load(path).server.tls == TlsConfig(
        folder / "server.pem", Path("/etc/server.key"), folder / "ca.pem", "engineer"
    )


def test_all_keys(write):
    config = load(
        write(
            """
            [modbus]
            tcp = false
            host = "0.0.0.0"
            port = 502
            connections = 3
            default_unit = "v"
            serial_port = "/dev/ttyUSB0"
            baud_rate = 9600
            parity = "none"
            stop_bits = 2
            [modbus.units.v]
            node = "valve"
            unit_id = 17
            word_order = "little"
            commands = true
            watchdog_ms = 2.5
            holes = "zero"
            inputs_also_at = 100
            """
        )
    )
    assert config.server == ServerConfig(
        is_on_tcp=False,
        host="0.0.0.0",  # noqa: S104 - it is only read
        port=502,
        connections=3,
        serial=SerialConfig("/dev/ttyUSB0", 9600, Parity.NONE, 2),
        default_unit=17,
    )
    (unit,) = config.units
    assert (unit.name, unit.node, unit.unit_id, unit.commands) == ("v", "valve", 17, True)
    assert (unit.watchdog, unit.holes) == (0.0025, Holes.ZERO)
    orders = {register.word_order for register in unit.register_map.registers if register.count > 1}
    assert orders == {WordOrder.LITTLE}


def test_input_registers_are_holding_registers_too(write):
    config = load(write("[modbus.units.pressure_a]\ninputs_also_at = 4\n"))
    registers = config.units[0].register_map
    inputs = registers.table(Table.INPUT_REGISTERS)
    copies = registers.table(Table.HOLDING_REGISTERS)[-len(inputs) :]
    assert [(copy.name, copy.address, copy.source) for copy in copies] == [
        (f"input_{register.name}", register.address + 4, register.source) for register in inputs
    ]
    assert {copy.access for copy in copies} == {RegisterAccess.READ}


@pytest.mark.parametrize(
    ("start", "wrong"),
    [
        # The holding registers of the map are 0 to 3, its input registers take eight.
        (3, "3 puts input_pressure on a holding register; 4 is free"),
        (65530, "65530 leaves no room for all input registers; give at most 65528"),
    ],
)
def test_copies_that_do_not_fit_are_refused(write, start, wrong):
    path = write(f"[modbus.units.pressure_a]\ninputs_also_at = {start}\n")
    assert problems(path) == [f"modbus.units.pressure_a.inputs_also_at: {wrong}"]


def test_copies_may_end_at_the_last_address(write):
    load(write("[modbus.units.pressure_a]\ninputs_also_at = 65528\n"))


def test_the_only_unit_is_the_default_one(write):
    assert load(write("[modbus.units.position]\n")).server.default_unit == 4
    assert load(write("[modbus]\n")).server.default_unit is None


def test_the_settings_say_where_each_value_came_from(write):
    config = load_config(write("[modbus]\nport = 1502\n[modbus.units.position]\n"))
    settings = {(s.table, s.key.name): (s.value, s.origin) for s in config.settings}
    assert settings["modbus", "port"] == (1502, Origin.FILE)
    assert settings["modbus", "host"] == ("127.0.0.1", Origin.DEFAULT)
    assert settings["modbus.units.position", "unit_id"] == (4, Origin.DEFAULT)


@from_text("text", "line")
def test_what_is_wrong_is_said_in_a_line(write, text, line):
    path = write(text)
    assert problems(path) == [line]


def test_a_node_without_an_id_needs_a_unit_id(write):
    path = write(
        """
        [nodes.valve]
        profile = "valve_408"
        node_id = 1
        [nodes.position]
        profile = "encoder_406"
        node_id = "unconfigured"
        serial_number = 5
        [modbus]
        """
    )
    assert problems(path) == [
        "modbus.units.position.unit_id: missing, as the node has no ID; give one from 1 to 247"
    ]


def test_a_map_for_another_profile_is_refused(write):
    other = REGISTERS / "encoder_406.toml"
    path = write(f"[modbus.units.pressure_a]\nregisters = '{other}'\n")
    wrong = f"modbus.units.pressure_a.registers: {other} is for encoder_406"
    assert problems(path) == [f"{wrong}; give a map for pressure_404"]


def test_problems_of_a_map_name_the_map_too(write):
    path = write('[modbus.units.pressure_a]\nregisters = "missing.toml"\n')
    (line,) = problems(path)
    assert line.startswith("modbus.units.pressure_a.registers: missing.toml: cannot be read")


def test_a_valve_that_plcs_command_waits_a_second_for_them(write):
    # OpenPLC polls each 100 ms, and each of its cycles takes the time of its requests as well.
    assert load(write("[modbus.units.valve]\n")).units[0].watchdog == 1.0
