"""One instance of an FMU, of FMI 2.0 or 3.0, behind the same calls."""

import ctypes
from collections.abc import Sequence
from typing import Any, NamedTuple

from hil_bench.errors import printable

_OK, _WARNING = 0, 1
_LONGEST = 300  # characters of what an FMU says of a failure


class SlaveError(Exception):
    """A call of an FMU has failed."""


class Setup(NamedTuple):
    """The set-up of an instance; plain values, which go to another process as JSON.

    Attributes:
        version: of FMI, 2 or 3.
        token: that its library is instantiated with.
        identifier: of its library.
        folder: where the FMU is unpacked.
        library: the file of its library.
        name: of the instance.
        step: the communication step [s].
        parameters: value references with what is set before the start.
        written: value references of its inputs.
        given: what they are at the start.
        read: value references of its outputs.
    """

    version: int
    token: str
    identifier: str
    folder: str
    library: str
    name: str
    step: float
    parameters: Sequence[tuple[int, float]]
    written: Sequence[int]
    given: Sequence[float]
    read: Sequence[int]


class Instance:
    """An instance of an FMU in this process, started, that goes on by whole communication steps.

    Args:
        setup: what it is made of.

    Raises:
        SlaveError: it cannot be started.
    """

    def __init__(self, setup: Setup) -> None:
        self._step = setup.step
        self._written = (ctypes.c_uint32 * len(setup.written))(*setup.written)
        self._given = (ctypes.c_double * len(setup.given))(*setup.given)
        self._read = (ctypes.c_uint32 * len(setup.read))(*setup.read)
        self._values = (ctypes.c_double * len(setup.read))()
        self._steps = 0
        self._slave = slave = _Slave(setup)
        slave.start(setup.parameters)
        slave.set(self._written, self._given)
        slave.get(self._read, self._values)

    @property
    def values(self) -> list[float]:
        """Its outputs, in its own units."""
        return list(self._values)

    def go_on(self, given: list[float], steps: int) -> list[float]:
        """Return the outputs after some communication steps; a failed one is a `SlaveError`."""
        self._given[:] = [*given]
        self._slave.set(self._written, self._given)
        for number in range(self._steps, self._steps + steps):
            self._slave.step(number * self._step, self._step)
        self._steps += steps
        self._slave.get(self._read, self._values)
        return list(self._values)

    def end(self) -> None:
        """Free it."""
        self._slave.end()


class _Slave:
    """The calls of an FMU, of whichever version."""

    def __init__(self, setup: Setup) -> None:
        self._version = setup.version
        self._said = ""
        arguments = {
            "guid": setup.token,
            "modelIdentifier": setup.identifier,
            "unzipDirectory": setup.folder,
            "libraryPath": setup.library,
            "instanceName": setup.name,
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
