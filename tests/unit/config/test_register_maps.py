"""Register map files."""

import pytest
from support.tables import from_text

from device_profiles import REGISTERS
from hil_bench.abilities.modbus.map_files import load_register_map
from hil_bench.abilities.modbus.protocol.register_map import (
    DATA_TYPES,
    DeviceIdentification,
    Register,
    RegisterAccess,
    Table,
    WordOrder,
)
from hil_bench.errors import ConfigError
from hil_bench.units import BAR, ONE

DEVICE = """
[device]
profile = "pressure_404"
vendor_name = "maker"
product_code = "PT-1"
revision = "1.0"
"""


def test_a_map_with_every_key(write):
    path = write(
        DEVICE
        + """
        vendor_url = "https://example.org"
        word_order = "little"
        [holding_registers.offset]
        address = 4
        type = "int32"
        unit = "bar"
        scale = 0.01
        word_order = "big"
        source = "0x6124.01"
        access = "rw"
        low = -1
        high = 1.5
        description = "of the zero"
        [input_registers.pressure]
        address = 7
        type = "float32"
        source = "pressure"
        [coils.zero]
        address = 0
        source = "zero"
        access = "command"
        """
    )
    register_map = load_register_map(path)
    assert register_map.source == str(path)
    assert register_map.profile == "pressure_404"
    assert register_map.identification == DeviceIdentification(
        "maker", "PT-1", "1.0", vendor_url="https://example.org"
    )
    coil, pressure, offset = register_map.registers
    assert (coil.name, coil.table, coil.access) == ("zero", Table.COILS, RegisterAccess.COMMAND)
    assert pressure.word_order is WordOrder.LITTLE
    assert (pressure.unit, pressure.scale) == (ONE, 1.0)  # neither is given: the number itself
    assert offset == Register(
        name="offset",
        table=Table.HOLDING_REGISTERS,
        address=4,
        source="0x6124.01",
        data_type=DATA_TYPES["int32"],
        unit=BAR,
        scale=0.01,
        word_order=WordOrder.BIG,
        access=RegisterAccess.WRITE,
        low=-1.0,
        high=1.5,
        description="of the zero",
    )


def test_the_word_order_of_bench_toml_wins_where_a_register_has_none(write):
    path = write(DEVICE + '[input_registers.p]\naddress = 0\ntype = "float32"\nsource = "p"\n')
    (register,) = load_register_map(path, word_order=WordOrder.LITTLE).registers
    assert register.word_order is WordOrder.LITTLE
    (register,) = load_register_map(path).registers
    assert register.word_order is WordOrder.BIG


def register(*lines, table="input_registers"):
    head = [f"[{table}.p]", "address = 0", 'type = "float32"', 'source = "p"']
    names = [line.split(" =")[0] for line in lines]
    return "\n".join([*(line for line in head if line.split(" =")[0] not in names), *lines, ""])


@from_text("text", "line")
def test_what_is_wrong_is_said_in_a_line(write, text, line):
    path = write(DEVICE + text)
    with pytest.raises(ConfigError) as caught:
        load_register_map(path)
    assert str(caught.value) == f"{path}:{line}"


@pytest.mark.parametrize(
    ("name", "value"),
    [("vendor_name", '"ä"'), ("revision", "1"), ("product_code", f'"{"x" * 65}"')],
)
def test_an_identification_that_cannot_be_sent_is_refused(write, name, value):
    lines = [f"{name} = {value}" if line.startswith(name) else line for line in DEVICE.split("\n")]
    with pytest.raises(ConfigError, match="cannot be sent; give at most 64 ASCII characters"):
        load_register_map(write("\n".join(lines)))


@pytest.mark.parametrize("path", sorted(REGISTERS.glob("*.toml")), ids=lambda path: path.stem)
def test_the_profiles_own_maps_are_sound(path):
    register_map = load_register_map(path)
    assert register_map.profile == path.stem
    for table in Table:
        registers = register_map.table(table)
        ends = [register.address + register.count for register in registers]
        # Without gaps, so that one request reads a table whole.
        assert [register.address for register in registers] == [0, *ends][: len(registers)]
    assert all(register.description for register in register_map.registers)
