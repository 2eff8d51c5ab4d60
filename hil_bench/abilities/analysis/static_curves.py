"""Static flow-pressure curves of the valve, eq. (14) (Ruderman 2017, fig. 3)."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import PlantParameters


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
    parameters: PlantParameters,
    *,
    orifice_states: npt.ArrayLike | None = None,
    points: int = 201,
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
