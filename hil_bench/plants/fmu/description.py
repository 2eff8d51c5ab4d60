"""The part of an FMU's model description that the bench needs."""

import stat
import sys
import zipfile
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Final

from hil_bench.errors import ConfigError

# The file of an FMU: a zip from anywhere, which is unpacked only where it is one.


LARGEST: Final = 2 << 30
"""Of the unpacked files [bytes]: beyond it, it is a bomb rather than a model."""

_MOST_FILES: Final = 100_000


def check_archive(path: Path) -> None:
    """Refuse what is no FMU, or would write beside its own folder, by a `ConfigError`."""
    with _open(path) as archive:
        _check_members(path, archive)


def unpack(path: Path, folder: Path) -> None:
    """Unpack an FMU into a folder.

    Raises:
        ConfigError: it is none, is damaged, or does not fit.
    """
    with _open(path) as archive:
        _check_members(path, archive)
        try:
            archive.extractall(folder)
        except (zipfile.BadZipFile, OSError, EOFError, NotImplementedError, RuntimeError) as error:
            raise ConfigError(f"{path}: cannot be unpacked: {error}") from None


def _open(path: Path) -> zipfile.ZipFile:
    try:
        return zipfile.ZipFile(path)
    except zipfile.BadZipFile:
        raise ConfigError(f"{path}: is no FMU: it is not a zip file") from None
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise ConfigError(f"{path}: cannot be read: {reason}; give an FMU") from None


def _check_members(path: Path, archive: zipfile.ZipFile) -> None:
    members = archive.infolist()
    names = {member.filename for member in members}
    if "modelDescription.xml" not in names:
        raise ConfigError(f"{path}: is no FMU: it has no modelDescription.xml")
    for member in members:
        parts = PurePosixPath(member.filename).parts
        is_outside = member.filename.startswith("/") or ".." in parts
        if is_outside or "\\" in member.filename or ":" in member.filename:
            wrong = f"{member.filename!r} would be written outside of it"
            raise ConfigError(f"{path}: {wrong}; such a file is no FMU")
        if stat.S_ISLNK(member.external_attr >> 16):
            raise ConfigError(f"{path}: {member.filename!r} is a link; such a file is no FMU")
    size = sum(member.file_size for member in members)
    if size > LARGEST or len(members) > _MOST_FILES:
        most = f"{LARGEST >> 30} GB in {_MOST_FILES} files"
        raise ConfigError(
            f"{path}: unpacks to {size} bytes in {len(members)} files; {most} is most"
        )


def platforms(path: Path) -> list[str]:
    """Return the platforms for which an FMU has binaries, as FMI names them."""
    with _open(path) as archive:
        parts = (PurePosixPath(name).parts for name in archive.namelist())
        found = {part[1] for part in parts if len(part) > 2 and part[0] == "binaries"}
    return sorted(found)


def library_of(path: Path, identifier: str, names: tuple[str, ...]) -> PurePosixPath:
    """Return the library of an FMU for this machine, within the archive.

    Args:
        path: the FMU.
        identifier: of its model.
        names: those that this machine has as a platform.

    Raises:
        ConfigError: it is for another platform.
    """
    suffix = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
    with _open(path) as archive:
        known = set(archive.namelist())
    for name in names:
        library = PurePosixPath("binaries", name, identifier + suffix)
        if str(library) in known:
            return library
    has = ", ".join(platforms(path)) or "none: it has sources alone"
    raise ConfigError(f"{path}: is for another platform: {has}; {' or '.join(names)} is right here")


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
