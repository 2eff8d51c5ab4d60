"""A result of `identify --json` as what is known: read as it was, and refused where it is none."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil_bench.abilities.identification.design.knowledge import read_knowledge
from hil_bench.errors import ConfigError


def entry(value: float, deviation: float, *, is_told: bool = True) -> dict[str, Any]:
    return {"value": value, "standard_deviation": deviation, "is_told": is_told}


RESULT: dict[str, Any] = {
    "parameters": {
        "moving_mass_kg": entry(25.0, 0.5),
        "orifice_width_mm": entry(20.0, 0.1, is_told=False),
    },
    "correlations": [[1.0, 0.5], [0.5, 1.0]],
    "noise": {"position": 2e-6, "P_A": None, "P_B": 5e3},
    "has_spool_position": True,
}


def write(path: Path, **changes: object) -> Path:
    path.write_text(json.dumps({**RESULT, **changes}), encoding="utf-8")
    return path


def test_a_result_is_read_in_si(tmp_path: Path) -> None:
    known = read_knowledge(write(tmp_path / "found.json"))

    assert known.values == {"m": 25.0}  # the width was not identified
    assert known.deviations == pytest.approx({"m": 0.5, "w": 1e-4})
    # 0.5 times both deviations, in the order that is asked for
    assert known.covariance(("w", "m")) == pytest.approx(
        np.array([[1e-8, 0.5 * 0.5 * 1e-4], [0.5 * 0.5 * 1e-4, 0.25]])
    )
    assert known.noise.tolist() == [2e-6, np.inf, 5e3]
    assert known.has_spool


@pytest.mark.parametrize(
    "changes",
    [
        {"parameters": {"colour": entry(1.0, 0.1)}},
        {"parameters": [1, 2]},
        {"parameters": {"moving_mass_kg": entry(1.0, -0.1)}, "correlations": [[1.0]]},
        {"parameters": {"moving_mass_kg": entry(1.0, float("nan"))}, "correlations": [[1.0]]},
        {"correlations": [[1.0]]},
        {"correlations": [[1.0, 1.5], [1.5, 1.0]]},
        {"correlations": [[1.0, "x"], [0.5, 1.0]]},
        {"noise": {"position": 2e-6}},
        {"noise": None},
    ],
)
def test_what_is_no_result_is_refused(tmp_path: Path, changes: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match="is no result of hil-bench identify --json"):
        read_knowledge(write(tmp_path / "found.json", **changes))


@pytest.mark.parametrize("content", [b"", b"\xff\xfe", b"[" * 100_000, b"7", b"{}"])
def test_another_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "found.json"
    path.write_bytes(content)

    with pytest.raises(ConfigError, match="is no result"):
        read_knowledge(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"found\.json: cannot be read"):
        read_knowledge(tmp_path / "found.json")
