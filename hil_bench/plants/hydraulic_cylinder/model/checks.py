"""Checks of a plant: impossible states, and parameters that contradict each other."""

import math

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model.constants import ExtensionState
from hil_bench.plants.hydraulic_cylinder.model.options import VACUUM_PRESSURE, PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.state import PlantState, require_finite_state
from hil_bench.plants.hydraulic_cylinder.model.stepping import Solver
from hil_bench.plants.hydraulic_cylinder.model.validation import require_finite, require_kind
from hil_bench.plants.hydraulic_cylinder.model.waves import check_line

_HARDEST = 10.0
"""Largest force that an impact takes into an end stop, in multiples of P_S A."""


def check_full_model(parameters: PlantParameters, options: PlantOptions) -> None:
    """Refuse edges that never open, cushions without an end, bristles that drive the piston.

    LuGre friction takes energy from the motion, never gives it, where sigma_1 (F_s - F_c) <=
    sigma F_c (Barabanov and Ortega, Necessary and sufficient conditions for passivity of the LuGre
    friction model, IEEE Transactions on Automatic Control 45(4), 2000).

    Raises:
        ParameterError: with these parameters they make no sense.
    """
    _check_edges(parameters, options)
    _check_cushions(parameters, options)
    if options.bristles is None:
        return
    F_c, weakening, sigma = parameters.F_c, parameters.F_s - parameters.F_c, parameters.sigma
    if F_c == 0.0:
        raise ParameterError("F_c = 0 N: must be greater than 0 for LuGre friction", "F_c")
    sigma_1 = options.bristles.sigma_1
    if sigma_1 * weakening > sigma * F_c:
        raise ParameterError(
            f"sigma_1 = {sigma_1:g} N s/m: must be {_round_down(sigma * F_c / weakening):g} N s/m "
            "or less, sigma F_c / (F_s - F_c), or LuGre friction drives the piston",
            "sigma_1",
            "sigma",
            "F_c",
            "F_s",
        )


def check_components(options: PlantOptions, solver: Solver) -> None:
    """Refuse components with states of their own where the solver has none of them.

    Raises:
        ParameterError: for a solver other than the bench's.
    """
    if solver is Solver.LINEARLY_IMPLICIT_MIDPOINT:
        return
    if options.has_lines:
        raise ParameterError(
            f"{solver.value} has no lines with waves: "
            f"{Solver.LINEARLY_IMPLICIT_MIDPOINT.value} is right",
            "line_a" if options.line_b is None else "line_b",
        )
    if not options.has_moving_components:
        return
    symbol = "pump_control" if options.counterbalance is None else "counterbalance"
    raise ParameterError(
        f"{solver.value} has no counterbalance valve and no pump that swivels: "
        f"{Solver.LINEARLY_IMPLICIT_MIDPOINT.value} is right",
        symbol,
    )


def check_lines(parameters: PlantParameters, options: PlantOptions, dt: float) -> None:
    """Refuse lines whose wave time no count of steps fits, as `line.check_line` does."""
    for symbol, line in (("line_a", options.line_a), ("line_b", options.line_b)):
        check_line(symbol, line, parameters.rho, dt)


def _check_edges(parameters: PlantParameters, options: PlantOptions) -> None:
    """Refuse an edge beyond the spool's travel, and one that leaks as if it were open.

    Raises:
        ParameterError: for the first such edge.
    """
    lands = options.lands
    if lands is None or not lands.are_apart:
        return
    forth = parameters.alpha + parameters.beta
    alpha, beta = options.alpha_negative, options.beta_negative
    back = parameters.alpha if alpha is None else alpha
    back += parameters.beta if beta is None else beta
    names = ("overlap_pa", "overlap_at", "overlap_pb", "overlap_bt")
    for name, overlap, travel in zip(
        names, lands.overlaps, (forth, back, back, forth), strict=True
    ):
        if overlap is not None and abs(overlap) >= travel:
            raise ParameterError(
                f"{name} = {overlap:g} m: must be less than the spool's travel, {travel:g} m",
                name,
            )
        opening = travel - (parameters.beta if overlap is None else overlap)
        if lands.null_opening >= opening:
            raise ParameterError(
                f"null_opening = {lands.null_opening:g} m: must be less than the opening of the "
                f"wide open edge, {opening:g} m",
                "null_opening",
            )


def _check_cushions(parameters: PlantParameters, options: PlantOptions) -> None:
    """Refuse a cushion as long as the stroke.

    Raises:
        ParameterError: for the first such cushion.
    """
    for cushion in (options.cushion_a, options.cushion_b):
        if cushion is not None and cushion.length >= 2.0 * parameters.h:
            raise ParameterError(
                f"length of the cushion = {cushion.length:g} m: must be shorter than the stroke, "
                f"{2.0 * parameters.h:g} m",
                "the cushion",
            )


def _round_down(value: float) -> float:
    """Return a value to three digits, no larger than it is."""
    digit = 10.0 ** (math.floor(math.log10(value)) - 2) if value > 0.0 else 1.0
    return math.floor(value / digit) * digit


def check_state(state: PlantState, parameters: PlantParameters, options: PlantOptions) -> None:
    """Refuse a state in which the full-order plant cannot be.

    Raises:
        ParameterError: the message names the first symbol that is wrong.
    """
    require_kind("state", state, PlantState)
    require_finite_state(state)
    floor = options.cavitation_floor
    for symbol, pressure in (("P_A", state.P_A), ("P_B", state.P_B), ("P_T", parameters.P_T)):
        if floor is not None and pressure < floor:
            raise ParameterError(
                f"{symbol} = {pressure:g} Pa: must be at least the cavitation floor, {floor:g} Pa"
            )
    x = min(max(state.x, -parameters.h), parameters.h)
    check_cavity("A", state.V_CA, parameters.V_A0 + parameters.A_A * x, state.P_A, floor)
    check_cavity("B", state.V_CB, parameters.V_B0 - parameters.A_B * x, state.P_B, floor)
    check_position(state.x, parameters, options)


def check_cavity(
    chamber: str, cavity: float, volume: float, pressure: float, floor: float | None
) -> None:
    """Refuse a cavity that its chamber cannot have.

    Args:
        chamber: "A" or "B".
        cavity: in it [m³].
        volume: of the chamber [m³].
        pressure: in the chamber [Pa].
        floor: cavitation floor [Pa], None for no floor.

    Raises:
        ParameterError: for a cavity that is negative, as large as the chamber or above the floor.
    """
    named = f"V_C{chamber} = {cavity:g} m³"
    if not 0.0 <= cavity < volume:
        raise ParameterError(
            f"{named}: must be 0 or greater, and smaller than the chamber, {volume:g} m³"
        )
    is_above = floor is None or not math.isclose(pressure, floor, rel_tol=1e-9, abs_tol=1e-3)
    if cavity > 0.0 and is_above:
        limit = "there is no cavitation floor" if floor is None else f"the floor is at {floor:g} Pa"
        raise ParameterError(f"{named}: must be 0 at P_{chamber} = {pressure:g} Pa, for {limit}")


def check_position(x: float, parameters: PlantParameters, options: PlantOptions) -> None:
    """Refuse a position to which no pressure and no impact takes the piston.

    Args:
        x: piston position [m].
        parameters: of the plant.
        options: of the plant; without an end stop every position is right.

    Raises:
        ParameterError: for a piston deeper in a stop than `_HARDEST` times P_S A presses it.
    """
    stop = options.end_stop
    if stop is None:
        return
    depth = _HARDEST * parameters.P_S * max(parameters.A_A, parameters.A_B) / stop.stiffness
    if abs(x) > parameters.h + depth:
        raise ParameterError(f"x = {x:g} m: must lie between the end stops at +-{parameters.h:g} m")


def check_extension(
    extension: ExtensionState | None, parameters: PlantParameters, options: PlantOptions
) -> ExtensionState:
    """Return the extension's start.

    Raises:
        ParameterError: for a state that no extension can have.
    """
    if extension is None:
        return ExtensionState(0.0, 0.0, parameters.P_S)
    require_kind("extension", extension, ExtensionState)
    *values, _ = extension
    names = ExtensionState._fields[: len(values)]
    for symbol, value, unit in zip(names, values, ("s", "m", "Pa", "", "", "m³/s"), strict=True):
        require_finite(symbol, value, unit)
    floor = VACUUM_PRESSURE if options.cavitation_floor is None else options.cavitation_floor
    if extension.P_S < floor:
        raise ParameterError(f"P_S = {extension.P_S:g} Pa: must be at least {floor:g} Pa")
    return extension
