"""The nodes of an axis by what they do."""

import pytest

from hil_bench import ConfigError, load_config
from hil_bench.abilities.common.members import find_members

B_FIRST = """
[plant.axis1]
[nodes]
of_b = { profile = "pressure_404", node_id = 3, source = "P_B" }
of_a = { profile = "pressure_404", node_id = 2, source = "P_A" }
rod = { profile = "encoder_406", node_id = 4 }
valve = { profile = "valve_408", node_id = 1 }
"""


def members(tmp_path, text):
    path = tmp_path / "bench.toml"
    path.write_text(text)
    return find_members(load_config(path), "axis1", "this test")


def test_transducers_are_told_apart_by_their_ports_whatever_their_order(tmp_path):
    names = [node.name for node in members(tmp_path, B_FIRST)]
    assert names == ["valve", "rod", "of_a", "of_b"]


def test_one_that_is_missing_is_named_with_who_needs_it(tmp_path):
    text = B_FIRST.replace('source = "P_A"', 'source = "P_B"')
    with pytest.raises(ConfigError) as caught:
        members(tmp_path, text)
    assert str(caught.value) == (
        "plant.axis1: no node is its pressure_404 at P_A; this test needs one"
    )
