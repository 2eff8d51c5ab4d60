"""The part of an FMU's model description that the bench needs."""

from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from hil_bench.errors import ConfigError
from hil_bench.plants.fmu.archive import check_archive, library_of

_REALS = {"Real", "Float64"}


@dataclass(frozen=True, slots=True)
class FmuVariable:
    """One variable.

    Attributes:
        reference: its value reference.
        causality: "input", "output", "parameter", "local" and others.
        is_real: whether it is a Real (FMI 2) or a Float64 (FMI 3).
        is_tunable: whether it may be set before the start.
        unit: as declared; empty for none.
        low: its least value, None where none is declared.
        high: its largest.
        start: its value at the start, None where none is declared.
    """

    reference: int
    causality: str
    is_real: bool
    is_fixed: bool
    unit: str
    low: float | None
    high: float | None
    start: float | None


@dataclass(frozen=True, slots=True)
class FmuDescription:
    """An FMU for co-simulation on this machine.

    Attributes:
        version: of FMI, 2 or 3.
        model: its name.
        token: that its library is instantiated with.
        identifier: of its library.
        library: where that stands in the archive.
        variables: by name.
        fixed_step: the communication step that it wants, or the step of which it takes multiples
            [s]; None for any.
        is_exact: whether it takes `fixed_step` alone.
    """

    version: int
    model: str
    token: str
    identifier: str
    library: PurePosixPath
    variables: dict[str, FmuVariable]
    fixed_step: float | None
    is_exact: bool


def require_fmpy() -> Any:  # noqa: ANN401 - a module without types
    """Return FMPy.

    Raises:
        ConfigError: it is not installed.
    """
    try:
        import fmpy  # noqa: PLC0415 - an extra, and slow to import
    except ImportError:
        right = "pip install 'hil-bench[fmu]' brings it"
        raise ConfigError(f'kind = "fmu" needs FMPy, which is not installed; {right}') from None
    return fmpy


def read_fmu(path: Path) -> FmuDescription:
    """Return the model description of an FMU.

    Raises:
        ConfigError: it is none for co-simulation on this machine.
    """
    fmpy = require_fmpy()
    check_archive(path)
    try:
        told = fmpy.read_model_description(str(path), validate=False)
        version = int(str(told.fmiVersion).split(".", maxsplit=1)[0])
        variables = {each.name: _variable(each) for each in told.modelVariables}
    except Exception as error:
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise ConfigError(f"{path}: its modelDescription.xml cannot be read: {reason}") from None
    if version not in {2, 3}:
        raise ConfigError(f"{path}: is of FMI {told.fmiVersion}; FMI 2.0 or 3.0 is right")
    slave = told.coSimulation
    if slave is None:
        wrong = "is for model exchange, without a solver"
        raise ConfigError(f"{path}: {wrong}; export it for co-simulation")
    fixed, is_exact = _fixed_step(told)
    return FmuDescription(
        version=version,
        model=told.modelName,
        token=told.guid if version == 2 else told.instantiationToken,
        identifier=slave.modelIdentifier,
        library=library_of(
            path,
            slave.modelIdentifier,
            (fmpy.platform if version == 2 else fmpy.platform_tuple,),
        ),
        variables=variables,
        fixed_step=fixed,
        is_exact=is_exact,
    )


def _variable(told: Any) -> FmuVariable:  # noqa: ANN401 - FMPy's record
    declared = told.declaredType
    return FmuVariable(
        reference=int(told.valueReference),
        causality=str(told.causality or "local"),
        is_real=told.type in _REALS and not told.dimensions,
        is_fixed=told.causality == "parameter" or told.initial in {"exact", "approx"},
        unit=str(told.unit or (declared.unit if declared is not None else "") or ""),
        low=_number(told.min),
        high=_number(told.max),
        start=_number(told.start),
    )


def _fixed_step(told: Any) -> tuple[float | None, bool]:  # noqa: ANN401 - FMPy's record
    """Return the step that an FMU wants, and whether it is the only one."""
    slave, experiment = told.coSimulation, told.defaultExperiment
    if (internal := _number(slave.fixedInternalStepSize)) is not None:
        return internal, False
    if slave.canHandleVariableCommunicationStepSize or experiment is None:
        return None, False
    return _number(experiment.stepSize), True


def _number(value: object) -> float | None:
    try:
        return float(str(value))
    except ValueError:
        return None
