"""One instance of an FMU, of FMI 2.0 or 3.0, behind the same four calls."""

import ctypes
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hil_bench.errors import printable
from hil_bench.plants.fmu.description import FmuDescription

_OK, _WARNING = 0, 1
_LONGEST = 300  # characters of what an FMU says of a failure


class SlaveError(Exception):
    """A call of an FMU has failed."""


class Slave:
    """An instance between its start and its end.

    Args:
        description: what the FMU says of itself.
        folder: where it is unpacked.
        name: of the instance.

    Raises:
        SlaveError: the library cannot be loaded, or will not be instantiated.
    """

    def __init__(self, description: FmuDescription, folder: Path, name: str) -> None:
        self._version = description.version
        self._said = ""
        arguments = {
            "guid": description.token,
            "modelIdentifier": description.identifier,
            "unzipDirectory": str(folder),
            "libraryPath": str(folder / description.library),
            "instanceName": name,
        }
        try:
            self._fmu = self._load(arguments)
        except Exception as error:
            raise SlaveError(self._reason(str(error))) from None

    def _load(self, arguments: dict[str, str]) -> Any:  # noqa: ANN401 - FMPy has no types
        if self._version == 2:
            from fmpy import fmi2  # noqa: PLC0415 - an extra, and slow to import

            slave = fmi2.FMU2Slave(**arguments)
            callbacks = fmi2.fmi2CallbackFunctions()
            callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(self._hear_2)
            callbacks.allocateMemory = fmi2.defaultCallbacks.allocateMemory
            callbacks.freeMemory = fmi2.defaultCallbacks.freeMemory
            slave.instantiate(callbacks=callbacks)
            return slave
        from fmpy import fmi3  # noqa: PLC0415

        slave = fmi3.FMU3Slave(**arguments)
        slave.instantiate(logMessage=self._hear_3)
        return slave

    def _hear_2(self, _environment: Any, _name: Any, status: int, _kind: Any, text: Any) -> None:  # noqa: ANN401 - C's types
        self._hear(status, text)

    def _hear_3(self, _environment: Any, status: int, _kind: Any, text: Any) -> None:  # noqa: ANN401
        self._hear(status, text)

    def _hear(self, status: int, text: bytes | None) -> None:
        """Keep the last thing that the FMU says of something worse than a warning."""
        if status > _WARNING and text:
            self._said = printable(text.decode("utf-8", "replace").strip())[:_LONGEST]

    def _reason(self, what: str) -> str:
        first = (what or "failed").splitlines()[0].rstrip(".")
        return f"{first}: {self._said}" if self._said else first

    def _call(self, name: str, *arguments: Any) -> Any:  # noqa: ANN401
        try:
            return getattr(self._fmu, name)(*arguments)
        except Exception as error:
            raise SlaveError(self._reason(str(error))) from None

    def start(self, values: Sequence[tuple[int, float]]) -> None:
        """Set values and initialise at time 0; a refusal is a `SlaveError`."""
        if self._version == 2:
            self._call("setupExperiment", None, 0.0)
        for reference, value in values:
            self.set((ctypes.c_uint32 * 1)(reference), (ctypes.c_double * 1)(value))
        self._call("enterInitializationMode")
        self._call("exitInitializationMode")

    def set(self, references: Any, values: Any) -> None:  # noqa: ANN401 - arrays of ctypes
        """Set real variables; a refusal is a `SlaveError`."""
        n, component = len(references), self._fmu.component
        if self._version == 2:
            self._call("fmi2SetReal", component, references, n, values)
        else:
            self._call("fmi3SetFloat64", component, references, n, values, n)

    def get(self, references: Any, values: Any) -> None:  # noqa: ANN401 - arrays of ctypes
        """Get real variables into `values`; a refusal is a `SlaveError`."""
        n, component = len(references), self._fmu.component
        if self._version == 2:
            self._call("fmi2GetReal", component, references, n, values)
        else:
            self._call("fmi3GetFloat64", component, references, n, values, n)

    def step(self, time: float, size: float) -> None:
        """Go on by a communication step [s].

        Raises:
            SlaveError: the step has failed, or the FMU wants to end.
        """
        if self._version == 2:
            self._call("fmi2DoStep", self._fmu.component, time, size, 1)
            return
        _, wants_end, is_early, _ = self._call("doStep", time, size)
        if wants_end or is_early:
            raise SlaveError("fmi3DoStep ended the simulation" if wants_end else "ended early")

    def end(self) -> None:
        """Terminate and free the instance; what goes wrong is of no interest any more."""
        for name in ("terminate", "freeInstance"):
            try:
                self._call(name)
            except SlaveError:
                continue
