"""The sought parameters: names, and the free variables that stand for them in the fit.

A positive parameter is sought as the logarithm of its ratio to a reference, so that steps are
relative and no step makes it negative. Dead-zone, leakage and F_s / F_c - 1 may be 0, and are
sought as multiples of a scale.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.model import PlantParameters, paper_parameters

Values = npt.NDArray[np.float64]

OFFSETS = ("offset_A", "offset_B")
"""Errors of the pressure sensors: sought beside the parameters, and no part of the result."""

SESSION_FLOW = "session_flow"
"""What the valve passes in each recording, as a factor of what it passes in the first.

It is sought beside the parameters, one for each recording but the first.
"""

_OFFSET_SCALE = 1e5  # [Pa]: the standard deviation that they are expected to have


class Kind(NamedTuple):
    """The transformation and the bounds of one unknown.

    Attributes:
        is_log: whether as a logarithm, or else as a multiple of the scale.
        lowest: bound of the free variable.
        highest: bound of the free variable.
        spread: standard deviation that the free variable is expected to have about its start.
        step: for the slopes.
        told_within: standard deviation up to which a record tells it.
    """

    is_log: bool
    lowest: float
    highest: float
    spread: float
    step: float
    told_within: float


_RATIO = Kind(is_log=True, lowest=-3.0, highest=3.0, spread=1.0, step=2e-3, told_within=0.1)

KINDS: Mapping[str, Kind] = {
    "w": _RATIO,
    "beta": Kind(is_log=False, lowest=0.0, highest=20.0, spread=1.0, step=2e-3, told_within=0.1),
    "alpha": _RATIO,
    "omega_0": _RATIO,
    "xi": _RATIO,
    # Air and pipes take the bulk modulus of good oil down by a factor of ten and more.
    "E": _RATIO._replace(lowest=-4.0, highest=4.0, spread=3.0),
    "F_c": _RATIO,
    "F_s": Kind(is_log=False, lowest=0.0, highest=10.0, spread=1.0, step=2e-3, told_within=0.1),
    "sigma": _RATIO,
    "chi": _RATIO,
    "C_L": Kind(is_log=False, lowest=0.0, highest=1e3, spread=30.0, step=0.05, told_within=1.0),
    "m": _RATIO,
}
"""All unknowns, in the order of the report."""

EXTRAS: Mapping[str, Kind] = {
    "P_S": _RATIO._replace(lowest=-1.5, highest=1.5, spread=0.3, told_within=0.05),
    "P_T": Kind(is_log=False, lowest=-0.9, highest=20.0, spread=2.0, step=5e-3, told_within=0.5),
    "h": _RATIO._replace(lowest=-0.02, highest=0.02, spread=0.005, step=1e-3, told_within=0.005),
    "gain": _RATIO._replace(lowest=-7.0, highest=7.0, spread=2.0, told_within=0.05),
    SESSION_FLOW: _RATIO._replace(lowest=-0.7, highest=0.7, spread=0.1),
    "position_delay": Kind(
        is_log=False, lowest=-2.0, highest=10.0, spread=2.0, step=1e-3, told_within=0.5
    ),
    "position_lag": Kind(
        is_log=False, lowest=0.0, highest=10.0, spread=2.0, step=1e-3, told_within=0.5
    ),
    "pressure_delay": Kind(
        is_log=False, lowest=-2.0, highest=10.0, spread=2.0, step=1e-3, told_within=0.5
    ),
    "pressure_lag": Kind(
        is_log=False, lowest=0.0, highest=10.0, spread=2.0, step=1e-3, told_within=0.5
    ),
}
"""Unknowns that are sought on demand only: pressures of supply and tank, what a command stands for,
how the flow drifts, delay and first-order lag of the sensors."""

SENSING = ("position_delay", "position_lag", "pressure_delay", "pressure_lag")
"""Those of `EXTRAS` that make up `Sensors`, in its order."""

_VALVE = ("w", "alpha", "beta")
_SCALES = {"P_T": 1e5, **dict.fromkeys(SENSING, 1e-3)}  # [Pa], [s]

_OFFSET = Kind(is_log=False, lowest=-20.0, highest=20.0, spread=1.0, step=5e-3, told_within=np.inf)


class Sensors(NamedTuple):
    """The lag and the delay of each sensor [s]."""

    position_delay: float = 0.0
    position_lag: float = 0.0
    pressure_delay: float = 0.0
    pressure_lag: float = 0.0


PROMPT = Sensors()


class Guess(NamedTuple):
    """The parameters that a vector of free variables stands for.

    Attributes:
        parameters: of the plant.
        offsets: errors of both pressure sensors in each recording, shape (recordings, 2) [Pa].
        sensors: how far they are behind.
        gain: of the command: times the set-points as they were read.
        flows: what the valve passes in each recording, as factors; empty where it does not differ.
    """

    parameters: PlantParameters
    offsets: Values
    sensors: Sensors = PROMPT
    gain: float = 1.0
    flows: tuple[float, ...] = ()

    def plant_in(self, session: int) -> PlantParameters:
        """Return the parameters in a recording."""
        if not self.flows or self.flows[session] == 1.0:
            return self.parameters
        return replace(self.parameters, w=self.flows[session] * self.parameters.w)

    def value(self, name: str) -> float:
        """Return the value of an unknown [SI]."""
        if name == "gain":
            return self.gain
        return float(getattr(self.sensors if name in SENSING else self.parameters, name))


@dataclass(frozen=True, slots=True)
class Unknowns:
    """The free variables of a fit: one a name, then the sensors' offsets and flows by recording.

    Attributes:
        known: what is configured; what is not sought stays as it is there.
        names: the sought parameters, of `KINDS` and `EXTRAS`.
        sessions: how many recordings there are.
        sensors: as configured.
        has_flows: whether the flow differs from recording to recording.
    """

    known: PlantParameters
    names: tuple[str, ...]
    sessions: int = 1
    sensors: Sensors = PROMPT
    has_flows: bool = False

    @property
    def kinds(self) -> list[Kind]:
        """Return the kind of each free variable."""
        offsets = [_OFFSET] * (len(OFFSETS) * self.sessions)
        flows = [kind_of(SESSION_FLOW)] * (self.sessions - 1 if self.has_flows else 0)
        return [*(kind_of(name) for name in self.names), *offsets, *flows]

    @property
    def start(self) -> Values:
        """The free variables of what is configured."""
        return self.variables_of(Guess(self.known, np.zeros((self.sessions, 2)), self.sensors))

    @property
    def bounds(self) -> tuple[Values, Values]:
        """Lowest and highest of each free variable."""
        lowest, highest = zip(*((kind.lowest, kind.highest) for kind in self.kinds), strict=True)
        return np.array(lowest), np.array(highest)

    @property
    def spreads(self) -> Values:
        """Expected standard deviation of each free variable about `start`."""
        return np.array([kind.spread for kind in self.kinds])

    @property
    def steps(self) -> Values:
        """Step of each free variable for the slopes."""
        return np.array([kind.step for kind in self.kinds])

    def guess(self, variables: Values) -> Guess:
        """Return the guess that the free variables stand for."""
        values: dict[str, float] = {}
        for name, variable in zip(self.names, variables.tolist(), strict=False):
            scale = scale_of(name, self.known)
            values[name] = scale * (np.exp(variable) if kind_of(name).is_log else variable)
        gain = values.pop("gain", 1.0)
        sensing = {name: values.pop(name) for name in SENSING if name in values}
        F_c = values.get("F_c", self.known.F_c)  # noqa: N806 - the paper's symbol
        sought = F_c * (1.0 + values["F_s"]) if "F_s" in values else self.known.F_s
        values["F_s"] = max(sought, F_c)
        for name in ("beta", "C_L"):
            values[name] = max(values.get(name, getattr(self.known, name)), 0.0)
        if "P_S" in values or "P_T" in values:
            lowest = values.get("P_T", self.known.P_T) + _OFFSET_SCALE
            values["P_S"] = max(values.get("P_S", self.known.P_S), lowest)
        if gain != 1.0:
            # The spool is linear: a gain of the command is one of what the valve makes of it.
            values["w"] = self.known.w * gain
            values |= {name: getattr(self.known, name) / gain for name in _VALVE[1:]}
        first, last = len(self.names), len(self.names) + len(OFFSETS) * self.sessions
        offsets = _OFFSET_SCALE * variables[first:last].reshape(self.sessions, -1)
        flows = (1.0, *np.exp(variables[last:]).tolist()) if self.has_flows else ()
        parameters = replace(self.known, **values)
        return Guess(parameters, offsets, self.sensors._replace(**sensing), gain, flows)

    def variables_of(self, guess: Guess) -> Values:
        """Return the free variables that stand for a guess, within the bounds."""
        variables = [self._variable(name, guess) for name in self.names]
        lowest, highest = self.bounds
        offsets = guess.offsets.reshape(-1) / _OFFSET_SCALE
        factors = (guess.flows or (1.0,) * self.sessions) if self.has_flows else ()
        flows = np.log(np.array(factors[1:]))
        return np.asarray(np.clip([*variables, *offsets, *flows], lowest, highest))

    def slopes_si(self, variables: Values) -> Values:
        """Return the slopes of parameters, offsets and flows [SI] by the free variables, square."""
        step = 1e-6
        here = self._si(variables)
        moved = [self._si(variables + shift) for shift in step * np.eye(len(variables))]
        return np.asarray((np.array(moved) - here).T / step)

    def _si(self, variables: Values) -> Values:
        guess = self.guess(variables)
        offsets = guess.offsets.reshape(-1)
        return np.array([*map(guess.value, self.names), *offsets, *guess.flows[1:]])

    def _variable(self, name: str, guess: Guess) -> float:
        if name == "F_s":
            return _excess(guess.parameters)
        ratio = guess.value(name) / scale_of(name, self.known)
        if not kind_of(name).is_log:
            return float(ratio)
        return float(np.log(ratio)) if ratio > 0.0 else 0.0


def kind_of(name: str) -> Kind:
    """Return the kind of an unknown."""
    return KINDS[name] if name in KINDS else EXTRAS[name]


def check_names(names: Sequence[str], sessions: int) -> None:
    """Refuse unknowns that act alike, or that one recording alone cannot tell.

    Raises:
        ConfigError: there are some.
    """
    if SESSION_FLOW in names and sessions < 2:
        raise ConfigError(f"{SESSION_FLOW} compares recordings; give two or more of them")
    if "gain" in names and not set(_VALVE).isdisjoint(names):
        raise ConfigError(
            "command_gain is not decidable beside the valve's width, opening and overlap, which "
            "act alike; --fix orifice_width_mm orifice_full_opening_mm spool_overlap_mm"
        )


def scale_of(name: str, known: PlantParameters) -> float:
    """Return the unit that a free variable of a parameter counts in.

    It is the configured value, or Table I's where none is configured. Leakage counts in a
    thousandth of what the fully open valve lets through at supply pressure; F_s in the excess over
    F_c.
    """
    if name in {"F_s", "gain"}:
        return 1.0
    if name in _SCALES:
        return _SCALES[name]
    if name == "C_L":
        return float(1e-3 * known.K * known.alpha / np.sqrt(known.P_S - known.P_T))
    return float(getattr(known, name) or getattr(paper_parameters(), name))


def _excess(parameters: PlantParameters) -> float:
    if not parameters.F_c:
        return _excess(paper_parameters())
    return parameters.F_s / parameters.F_c - 1.0
