"""All checks of the plant: the paper's cylinder, and those of a bench."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from hil_bench.abilities.analysis.validation.check import ValidationCheck
from hil_bench.abilities.analysis.validation.closed_forms import closed_form_checks
from hil_bench.abilities.analysis.validation.published import published_checks
from hil_bench.abilities.analysis.validation.subject import Subject
from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_bench.plants.hydraulic_cylinder.model import Model, paper_parameters
from hil_bench.plants.kind import AxisConfig

PAPER = "Table I"
"""Name of the paper's cylinder."""


def validate(axes: Iterable[AxisConfig], dt: float) -> Iterator[ValidationCheck]:
    """Check the model with the paper's parameters, and with those of each cylinder of a bench.

    Extensions of a cylinder and its leakage are off: their closed forms are those of tests.

    Args:
        axes: of the bench.
        dt: step of its solvers [s].

    Yields:
        One check after the other.
    """
    paper = Subject(name=PAPER, parameters=paper_parameters())
    yield from published_checks(paper)
    yield from closed_form_checks(paper)
    for axis in axes:
        yield from _axis_checks(axis, dt)


def _axis_checks(axis: AxisConfig, dt: float) -> Iterator[ValidationCheck]:
    if not isinstance(axis, CylinderConfig):
        yield _without_checks(axis, f"it is a {axis.kind.name}, not a cylinder")
        return
    if axis.model is not Model.FULL_ORDER:
        yield _without_checks(axis, "the closed forms are those of the full-order model")
        return
    parameters = replace(axis.parameters, C_L=0.0)
    subject = Subject(name=axis.name, parameters=parameters, solver=axis.solver, dt=dt)
    try:
        yield from closed_form_checks(subject)
    except ParameterError as error:
        yield _without_checks(axis, str(error))


def _without_checks(axis: AxisConfig, reason: str) -> ValidationCheck:
    return ValidationCheck(
        subject=axis.name,
        name="closed forms",
        unit="-",
        source="equations (1)-(13)",
        detail=reason,
    )
