"""What docs/connecting.md tells users of a tool to import, imported by that tool."""

import pytest
import yaml
from support import documents
from support.dcfgen import run_dcfgen
from support.documents import ROOT

BLOCKS = [each for each in documents.blocks("yaml") if each.path.name == "connecting.md"]


def test_dcfgen_takes_the_configuration_of_the_lely_master(tmp_path):
    (block,) = BLOCKS
    eds = {path.stem: path for path in (ROOT / "device_profiles").glob("*.eds")}
    run_dcfgen(tmp_path, block.text, **eds)
    # A concise DCF (CiA 302-3): number of entries, then index, sub-index, size and value of each.
    requests = (tmp_path / "valve.bin").read_bytes()
    assert b"\x16\x10\x01\x04\x00\x00\x00" + (300 | 127 << 16).to_bytes(4, "little") in requests
    assert b"\x00\x14\x05\x02\x00\x00\x00" + (100).to_bytes(2, "little") in requests


@pytest.mark.parametrize(("name", "node_id"), [("valve", 1), ("pressure_a", 2), ("position", 4)])
def test_the_node_ids_are_those_of_the_bench(name, node_id):
    (block,) = BLOCKS
    assert yaml.safe_load(block.text)[name]["node_id"] == node_id
