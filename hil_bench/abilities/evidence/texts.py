"""The pack's texts about the tool itself: known defects, notes on classification."""

import tomllib
from importlib.resources import files
from typing import Any

_PACKAGE = "hil_bench.abilities.evidence"


def known_defects() -> list[dict[str, str]]:
    """List the known defects: id, subject, text, consequence."""
    defects: list[dict[str, str]] = _load("known_defects.toml")["defect"]
    return defects


def classification() -> dict[str, object]:
    """Return the template of the notes on tool classification."""
    return _load("classification.toml")


def _load(name: str) -> dict[str, Any]:
    return tomllib.loads(files(_PACKAGE).joinpath(name).read_text("utf-8"))
