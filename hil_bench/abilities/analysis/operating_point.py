"""Operating points of a cylinder, and the static curves of its valve."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.analysis.steady_motion import (
    OperatingPoint,
    OperatingPointError,
    motion_at_spool_position,
    motion_at_velocity,
    orifice_state_at,
    rest,
    state_rates,
)
from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import PlantOptions, PlantParameters, PlantState
from hil_bench.plants.hydraulic_cylinder.model.validation import require_finite

# Trim: the operating point of the full-order model under given conditions.
#
# The search starts from the closed form of `steady_motion`; Newton's method then meets what the
# options and leakage change.

_ITERATIONS = 30
_CONVERGED = 1e-9  # largest correction, as a share of the unknown's scale


def find_operating_point(
    parameters: PlantParameters,
    options: PlantOptions | None = None,
    *,
    position: float = 0.0,
    velocity: float | None = None,
    spool_position: float | None = None,
    load: float = 0.0,
    mean_pressure: float | None = None,
) -> OperatingPoint:
    """Return the operating point at a piston velocity or at a spool position.

    Args:
        parameters: of the plant.
        options: what the paper leaves open; None for the paper's reading.
        position: of the piston, x [m].
        velocity: of the piston [m/s]; give this or `spool_position`.
        spool_position: nu [m].
        load: F_L [N].
        mean_pressure: of both chambers at rest [Pa]; None for the middle of supply and tank. In
            motion the orifices decide.

    Raises:
        ParameterError: not one of velocity and spool position is given, or the point is off the
            stroke.
    """
    options = PlantOptions.paper() if options is None else options
    _check_options(options)
    if (velocity is None) is (spool_position is None):
        raise ParameterError("operating point: give a velocity or a spool position, one of them")
    given = velocity if velocity is not None else spool_position
    for symbol, value, unit in (("x", position, "m"), ("F_L", load, "N"), ("v, nu", given, "")):
        require_finite(symbol, value or 0.0, unit)
    if abs(position) >= parameters.h:
        raise ParameterError(
            f"x = {position:g} m: must lie within the stroke, +-{parameters.h:g} m"
        )
    if velocity is not None:
        start = motion_at_velocity(parameters, options, position, velocity, load)
    else:
        start = motion_at_spool_position(parameters, options, position, spool_position or 0.0, load)
    if start is None:
        point = rest(parameters, position, spool_position or 0.0, load, mean_pressure)
        _check_rest(parameters, options, point)
    else:
        _check_pressures(options, start)
        point = _refined(parameters, options, start, keeps_velocity=velocity is not None)
    _check_pressures(options, point)
    return point


def _check_options(options: PlantOptions) -> None:
    """Refuse what has states of its own, or what makes the position act back.

    Raises:
        OperatingPointError: such an option is on.
    """
    for name in ("bristles", "supply", "counterbalance", "line_a", "line_b", "loads"):
        if getattr(options, name, None):
            raise OperatingPointError(
                f"{name}: an operating point is one of eqs. (1)-(13), without {name}; "
                "give what acts on the rod as the load F_L"
            )


def _check_rest(parameters: PlantParameters, options: PlantOptions, point: OperatingPoint) -> None:
    """Refuse a rest in which the pressures creep.

    Raises:
        OperatingPointError: they do.
    """
    rates = state_rates(parameters, options, point.state, point.plant_input)
    creep = float(np.abs(rates[2:4]).max())
    if creep > 1e-9 * parameters.E:
        raise OperatingPointError(
            f"no rest with a closed valve: leakage lets the pressures creep by {creep:.3g} Pa/s; "
            "give a velocity, or a spool position beyond the dead zone"
        )


def _refined(
    parameters: PlantParameters,
    options: PlantOptions,
    start: OperatingPoint,
    *,
    keeps_velocity: bool,
) -> OperatingPoint:
    """Return the operating point next to `start` by Newton's method in P_A, P_B and nu or v.

    Raises:
        OperatingPointError: there is none.
    """
    unknown = [2, 3, 4 if keeps_velocity else 1]
    pressure = parameters.P_S - parameters.P_T
    scales = np.array([pressure, pressure, abs(start.state[unknown[2]])])
    plant_input = start.plant_input
    state = np.array(start.state[:6])  # no cavity at an operating point

    def rates(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return state_rates(parameters, options, PlantState(*map(float, values)), plant_input)[1:4]

    for _ in range(_ITERATIONS):
        slopes = np.empty((3, 3))
        for column, (index, scale) in enumerate(zip(unknown, scales, strict=True)):
            step = np.zeros(6)
            step[index] = 1e-7 * scale
            slopes[:, column] = (rates(state + step) - rates(state - step)) / 2e-7
        try:
            correction = np.linalg.solve(slopes, -rates(state))
        except np.linalg.LinAlgError:
            break
        if not np.isfinite(correction).all():
            break
        correction *= min(1.0, 0.2 / float(np.abs(correction).max() or 1.0))
        state[unknown] += correction * scales
        if np.abs(correction).max() < _CONVERGED:
            return _as_point(parameters, options, state, start.load)
    raise OperatingPointError(
        f"no steady motion found near v = {start.velocity:g} m/s, "
        f"spool position {start.spool_position * 1e3:g} mm, load {start.load:g} N"
    )


def _as_point(
    parameters: PlantParameters, options: PlantOptions, state: npt.NDArray[np.float64], load: float
) -> OperatingPoint:
    x, v, pressure_a, pressure_b, nu, _ = map(float, state)
    return OperatingPoint(
        position=x,
        velocity=v,
        pressure_a=pressure_a,
        pressure_b=pressure_b,
        spool_position=nu,
        orifice_state=orifice_state_at(parameters, options, nu),
        load=load,
    )


def _check_pressures(options: PlantOptions, point: OperatingPoint) -> None:
    """Refuse pressures that the oil cannot have.

    Raises:
        OperatingPointError: a chamber would be below the cavitation floor.
    """
    floor = options.cavitation_floor
    for chamber, pressure in (("A", point.pressure_a), ("B", point.pressure_b)):
        if floor is not None and pressure < floor:
            raise OperatingPointError(
                f"no such operating point: chamber {chamber} would be at {pressure:.4g} Pa, below "
                f"the cavitation floor of {floor:g} Pa"
            )


# Static flow-pressure curves of the valve, eq. (14) (Ruderman 2017, fig. 3).


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlowPressureCurves:
    """Load flow over load pressure, one curve an orifice state.

    Attributes:
        orifice_states: z [m], shape (curves,).
        load_pressure: P_L [Pa], shape (points,).
        flow: Q_L [m³/s], shape (curves, points).
    """

    orifice_states: npt.NDArray[np.float64]
    load_pressure: npt.NDArray[np.float64]
    flow: npt.NDArray[np.float64]


def flow_pressure_curves(
    parameters: PlantParameters, *, orifice_states: npt.ArrayLike | None = None, points: int = 201
) -> FlowPressureCurves:
    """Return Q_L = z K sqrt((P_S - sign(z) P_L) / 2) for P_L up to P_S, eq. (14).

    Args:
        parameters: of the plant; P_S counts from P_T.
        orifice_states: z [m]; None for eleven from closed to fully open.
        points: of each curve; they lie closer where the root is steep.

    Raises:
        ParameterError: an orifice state beyond the valve's opening, or fewer than two points.
    """
    alpha = parameters.alpha
    states = np.linspace(0.0, alpha, 11) if orifice_states is None else np.array(orifice_states)
    if states.ndim != 1 or not (np.abs(states) <= alpha).all():
        raise ParameterError(f"orifice states: must lie within the valve's +-{alpha:g} m, in a row")
    if points < 2:
        raise ParameterError(f"points = {points}: a curve needs 2 or more")
    supply = parameters.P_S - parameters.P_T
    load_pressure = supply * (1.0 - np.linspace(1.0, 0.0, points) ** 2)
    flow = load_flow(parameters, states[:, np.newaxis], load_pressure)
    return FlowPressureCurves(orifice_states=states, load_pressure=load_pressure, flow=flow)


def load_flow(
    parameters: PlantParameters, orifice_state: npt.ArrayLike, load_pressure: npt.ArrayLike
) -> npt.NDArray[np.float64]:
    """Return Q_L = z K sqrt((P_S - sign(z) P_L) / 2) [m³/s], eq. (14).

    Args:
        parameters: of the plant; P_S counts from P_T.
        orifice_state: z [m], any shape.
        load_pressure: P_L [Pa], of a shape that fits; beyond P_S nothing flows.
    """
    state = np.asarray(orifice_state, dtype=np.float64)
    side = np.where(state < 0.0, -1.0, 1.0)
    supply = parameters.P_S - parameters.P_T
    drop = np.maximum(supply - side * np.asarray(load_pressure), 0.0)
    return np.asarray(state * parameters.K * np.sqrt(0.5 * drop))
