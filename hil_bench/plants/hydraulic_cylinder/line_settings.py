"""The lines of an axis from its keys: as volumes of the chambers, or with waves."""

from hil_bench.config.settings import Settings, convert
from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.keys import VISCOSITY_KEY, WALL_KEYS, LineModel
from hil_bench.plants.hydraulic_cylinder.model.waves import Line, korteweg

_STEEL = 206e9
"""Young's modulus of a steel pipe [Pa]."""


def build_lines(axis: Settings) -> dict[str, Line | None]:
    """Return the lines with waves, as `PlantOptions` has them.

    Raises:
        ParameterError: their data are missing or given twice, or there is no line.
    """
    lines = {side: _build_line(axis, side) for side in "ab"}
    has_waves = axis["line_model"].value is LineModel.WAVES
    if has_waves and not any(lines.values()):
        right = "give line_a_length_m and line_a_inner_mm too, or those of line B"
        raise ParameterError(f"waves need a line: {right}", "line_model")
    return {f"line_{side}": line for side, line in lines.items()}


def _build_line(axis: Settings, side: str) -> Line | None:
    """Return a line with waves; None where there is none.

    Raises:
        ParameterError: its data are missing, given twice or make no sense.
    """
    names = (f"line_{side}_length_m", f"line_{side}_inner_mm")
    wall_names = tuple(key.name for key in WALL_KEYS[side])
    given = [name for name in (*names, *wall_names) if axis[name].value is not None]
    if axis["line_model"].value is not LineModel.WAVES:
        for name in wall_names:
            if name in given:
                raise ParameterError(
                    'without waves it says nothing: give line_model = "waves"', name
                )
        return None
    if not given:
        return None
    for name in names:
        if name not in given:
            raise ParameterError(
                f"a line has a length and an inner diameter: give {name} too", given[0]
            )
    if len(given) == len(names) + len(wall_names):
        right = f"leave out one of {' and '.join(wall_names)}"
        raise ParameterError(f"given twice, for the wall says it too: {right}", wall_names[0])
    length, inner = (axis[name].key.unit.to_si(axis[name].value) for name in names)
    modulus = _modulus(axis, side, inner)
    try:
        return Line(
            length=length,
            inner=inner,
            bulk_modulus=modulus,
            **convert(axis, (VISCOSITY_KEY,)),
        )
    except ParameterError as error:
        places = {
            "length": names[0],
            "inner": names[1],
            "bulk_modulus": wall_names[0],
            "viscosity": VISCOSITY_KEY.name,
        }
        raise ParameterError(str(error), places[error.symbols[0]]) from None


def _modulus(axis: Settings, side: str, inner: float) -> float:
    """Return the bulk modulus of the oil in a line with its wall [Pa].

    Raises:
        ParameterError: the wall is none.
    """
    own, wall = convert(axis, WALL_KEYS[side]).values()
    if own is not None:
        return float(own)
    oil = axis["bulk_modulus_mpa"].key.unit.to_si(axis["bulk_modulus_mpa"].value)
    if wall is None:
        return oil
    if wall <= 0.0 or wall >= inner:
        name = f"line_{side}_wall_mm"
        raise ParameterError(
            f"wall = {wall:g} m: must be greater than 0 and less than the inner diameter", name
        )
    return korteweg(oil, inner, wall, _STEEL)
