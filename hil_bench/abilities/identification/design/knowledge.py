"""The knowledge of the sought parameters before a manoeuvre."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.choice import KEYS
from hil_bench.abilities.identification.identify import Identification
from hil_bench.abilities.identification.record import SIGNALS
from hil_bench.errors import ConfigError, about_file

Values = npt.NDArray[np.float64]

_MOST_BYTES = 10_000_000


class Knowledge(NamedTuple):
    """The knowledge from an identification.

    Attributes:
        values: of the identified parameters [SI], by name.
        deviations: standard deviation of each sought parameter [SI].
        correlations: of the sought parameters in the order of `deviations`.
        noise: of each of `SIGNALS` [SI], shape (3,); infinite where there was none.
        has_spool: whether the spool's position was recorded.
    """

    values: dict[str, float]
    deviations: dict[str, float]
    correlations: Values
    noise: Values
    has_spool: bool

    @classmethod
    def of(cls, found: Identification) -> "Knowledge":
        """Return the knowledge from an identification."""
        return cls(
            {one.name: one.value for one in found.told},
            {one.name: one.deviation for one in found.estimates},
            found.correlations,
            found.record.noise,
            found.record.spool is not None,
        )

    def beside(self, name: str, deviation: float) -> "Knowledge":
        """Return the same with a parameter of which only what is expected is known [SI]."""
        if name in self.deviations:
            return self
        count = len(self.deviations)
        correlations = np.eye(count + 1)
        correlations[:count, :count] = self.correlations
        deviations = {**self.deviations, name: deviation}
        return self._replace(deviations=deviations, correlations=correlations)

    def covariance(self, names: tuple[str, ...]) -> Values:
        """Return the covariance of some parameters [SI]."""
        places = [list(self.deviations).index(name) for name in names]
        deviations = np.array([self.deviations[name] for name in names])
        part = self.correlations[np.ix_(places, places)]
        return np.asarray(part * np.outer(deviations, deviations))


def read_knowledge(path: Path) -> Knowledge:
    """Return the knowledge in a file of `hil-bench identify --json`; `ConfigError` for others."""
    with about_file(path, what="cannot be read"):
        content = path.read_bytes()[: _MOST_BYTES + 1]
    wrong = ConfigError(f"{path}: is no result of hil-bench identify --json")
    if len(content) > _MOST_BYTES:
        raise wrong
    try:
        document = json.loads(content)
        return _read(document)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise wrong from None


def _read(document: Mapping[str, Any]) -> Knowledge:
    """Return the content of a document.

    Raises:
        ValueError: a number is none that could be; another document raises other errors.
    """
    name_of = {key.name: name for name, key in KEYS.items()}
    values, deviations = {}, {}
    for key, entry in document["parameters"].items():
        name, unit = name_of[key], KEYS[name_of[key]].unit
        deviations[name] = unit.to_si(_number(entry["standard_deviation"]))
        if entry["is_told"] is True:
            values[name] = unit.to_si(_number(entry["value"]))
        if deviations[name] <= 0.0:
            raise ValueError
    correlations = np.array(document["correlations"], dtype=np.float64)
    count = len(deviations)
    if correlations.shape != (count, count) or not np.isfinite(correlations).all():
        raise ValueError
    least = np.linalg.eigvalsh(0.5 * (correlations + correlations.T)).min()
    if not np.allclose(np.diag(correlations), 1.0) or least < -1e-6:
        raise ValueError
    noise = [document["noise"][signal] for signal in SIGNALS]
    has_spool = document["has_spool_position"]
    return Knowledge(
        values,
        deviations,
        correlations,
        np.array([math.inf if one is None else _number(one) for one in noise]),
        has_spool is True,
    )


def _number(value: object) -> float:
    """Return a finite number.

    Raises:
        ValueError: it is none.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError
    return float(value)
