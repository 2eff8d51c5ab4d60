"""What docs/connecting.md tells users of a tool to import, imported by that tool."""

import shutil
import subprocess
import sys

import pytest
import yaml
from support import documents
from support.documents import ROOT

BLOCKS = [each for each in documents.blocks("yaml") if each.path.name == "connecting.md"]

DCFGEN = "import sys; sys.path.insert(0, '.'); from dcfgen.cli import main; main()"
PKG_RESOURCES = """
import importlib.util, pathlib
def resource_filename(module, name):
    return str(pathlib.Path(importlib.util.find_spec(module).origin).parent / name)
"""
"""What dcfgen wants of setuptools, which has dropped it: the place of its own template."""


def test_dcfgen_takes_the_configuration_of_the_lely_master(tmp_path):
    (block,) = BLOCKS
    for eds in (ROOT / "device_profiles").glob("*.eds"):
        shutil.copy(eds, tmp_path)
    (tmp_path / "master.yml").write_text(block.text, encoding="utf-8")
    (tmp_path / "pkg_resources.py").write_text(PKG_RESOURCES, encoding="utf-8")
    done = subprocess.run(  # noqa: S603 - a tool of the environment
        [sys.executable, "-c", DCFGEN, "master.yml"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    # A concise DCF (CiA 302-3): number of entries, then index, sub-index, size and value of each.
    requests = (tmp_path / "valve.bin").read_bytes()
    assert b"\x16\x10\x01\x04\x00\x00\x00" + (300 | 127 << 16).to_bytes(4, "little") in requests
    assert b"\x00\x14\x05\x02\x00\x00\x00" + (100).to_bytes(2, "little") in requests


@pytest.mark.parametrize(("name", "node_id"), [("valve", 1), ("pressure_a", 2), ("position", 4)])
def test_the_node_ids_are_those_of_the_bench(name, node_id):
    (block,) = BLOCKS
    assert yaml.safe_load(block.text)[name]["node_id"] == node_id
