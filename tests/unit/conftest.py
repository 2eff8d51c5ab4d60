"""What tests of several rooms need."""

import sys

import pytest


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder in which distributions may be installed for one test."""
    # Not above: the tests of the CANopen device run where nothing else of the bench is.
    from hil_bench.kinds.registry import KINDS  # noqa: PLC0415 - see above
    from hil_bench.plants.registry import PLANTS  # noqa: PLC0415

    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(folder)
    before = set(sys.modules)
    for registry in (KINDS, PLANTS):
        monkeypatch.setattr(registry, "_loaded", {})
    yield folder
    for name in set(sys.modules) - before:
        del sys.modules[name]
