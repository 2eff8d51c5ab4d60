"""The tables [j1939.NAME]: what their page says, and what is refused."""

import json
import re
from pathlib import Path

import pytest
from support.tables import from_text

from hil_bench import ConfigError, load_config
from hil_bench.abilities.j1939.configuration.ecus import _COMMON_KEYS, ECU_KINDS
from hil_bench.abilities.j1939.kinds.signal_table import SENT_KEYS, TAKEN_KEYS

PAGE = (Path(__file__).parents[3] / "docs" / "j1939.md").read_text(encoding="utf-8")
ROWS = {
    name: (unit, default)
    for name, unit, default in re.findall(r"^\| `(\w+)` \| (.+?) \| (.+?) \|", PAGE, re.MULTILINE)
}
TABLES = (_COMMON_KEYS, *(kind.keys for kind in ECU_KINDS.values()), SENT_KEYS, TAKEN_KEYS)
KEYS = {key.name: key for keys in TABLES for key in keys if key.name != "sink"}

LEVER = "[j1939.lever]\naddress = 19\n[j1939.lever.signals]\n"
X = "x = { pgn = 0xFDD6, start_bit = 6, length = 10 }\n"


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "bench.toml"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("key", KEYS.values(), ids=KEYS)
def test_the_page_has_each_key_with_its_unit_and_default(key):
    unit, default = ROWS[key.name]

    assert unit == key.unit.symbol
    if key.example:
        assert default == "must be given"
    elif key.default is not None and key.name != "timeout_ms":
        assert default == f"`{json.dumps(key.default)}`"


@from_text("text", "message")
def test_what_is_wrong_is_one_line(write, text, message):
    with pytest.raises(ConfigError) as caught:
        load_config(write(text))

    assert message in str(caught.value)
    is_whole = 'axis = "axis2"' in text  # which leaves axis1 without a valve
    assert len(str(caught.value).splitlines()) == 1 + is_whole


def test_such_devices_need_no_plant_and_no_node(write):
    config = load_config(write(LEVER + X))

    assert (config.axes, config.nodes) == ((), ())
    assert [ecu.name for ecu in config.ecus] == ["lever"]


def test_two_devices_of_one_name_field_differ_by_their_own_names(write):
    text = LEVER + X + "[j1939.b]\naddress = 20\n[j1939.b.signals]\n" + X

    first, second = load_config(write(text)).ecus

    assert first.identity.identity != second.identity.identity


def test_each_auxiliary_valve_has_parameter_groups_of_its_own():
    # ISO 11783-7: commands 0xFE30 and estimated flows 0xFE10 of valve 0, upwards to those of 15.
    valve = {"kind": "auxiliary_valve", "address": 128, "valve": 15}
    (config,) = load_config(tables={"plant": {"axis1": {}}, "j1939": {"valve": valve}}).ecus
    assert [message.group for message in config.kind.messages(config)] == [0xFE3F, 0xFE1F]
