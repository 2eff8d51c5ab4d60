"""What tests of several rooms need."""

import sys

import pytest

from hil_bench.kinds.registry import KINDS
from hil_bench.plants.registry import PLANTS


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder in which distributions may be installed for one test."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(folder)
    before = set(sys.modules)
    for registry in (KINDS, PLANTS):
        monkeypatch.setattr(registry, "_loaded", {})
    yield folder
    for name in set(sys.modules) - before:
        del sys.modules[name]
