"""The drivers of a run's time: the runner alone, an example controller, or firmware."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from hil_bench.abilities.scenario.controllers import CONTROLLERS, settings_of
from hil_bench.abilities.scenario.director import Director, FirmwareHook
from hil_bench.abilities.scenario.records import FirmwareCommand
from hil_bench.errors import ControllerError
from hil_bench.session.firmware import HUB, Firmware, FirmwareBus
from hil_bench.session.virtual_bench import VirtualBench
from hil_drivers import DriverError


class Timekeeper(Protocol):
    """Lets the time of a run pass."""

    on_firmware: FirmwareHook | None

    def drive(self, director: Director, last_tick: int) -> str:
        """Let time pass until the run is over; return how a controller ended before that."""


class NobodyDriver:
    """Nobody drives: the steps alone act.

    Args:
        bench: on which.
    """

    on_firmware: FirmwareHook | None = None

    def __init__(self, bench: VirtualBench) -> None:
        self._bench = bench

    def drive(self, director: Director, last_tick: int) -> str:
        """Run all ticks."""
        self._bench.session.tick((), 0)
        _run_alone(self._bench, director, last_tick)
        return ""


class ExampleDriver:
    """An example controller drives.

    Args:
        bench: on which.
        name: of the controller.
        parameters: of the scenario, in SI.
    """

    on_firmware: FirmwareHook | None = None

    def __init__(self, bench: VirtualBench, name: str, parameters: Mapping[str, float]) -> None:
        self._bench = bench
        self._cycles = CONTROLLERS[name](bench, settings_of(parameters))

    def drive(self, director: Director, last_tick: int) -> str:
        """Let the controller run; where a device ends it in its work, go on without.

        Raises:
            ControllerError: it could not begin.
        """
        self._bench.session.tick((), 0)
        ending, has_begun = "", False
        try:
            for _ in self._cycles:
                has_begun = True
                if director.is_over:
                    break
        except (DriverError, ValueError) as error:
            if not has_begun or not isinstance(error, DriverError):
                raise ControllerError(f"the controller could not work: {error}") from error
            ending = f"the controller ended: {error}"
        finally:
            with suppress(DriverError):  # a valve that is dead cannot be disabled
                self._cycles.close()
        _run_alone(self._bench, director, last_tick)
        return ending


class FirmwareDriver:
    """A program drives, in lock-step; while none runs, time passes without.

    Args:
        bench: on which.
        words: the command line, with ``{bus}``.
        directory: for its output.
        first: the first of the steps that concern it, in a list; it starts now unless that is its
            start.
    """

    def __init__(
        self,
        bench: VirtualBench,
        words: Sequence[str],
        directory: Path,
        first: Sequence[FirmwareCommand],
    ) -> None:
        self.on_firmware: FirmwareHook | None = self._obey
        self._bench, self._words, self._directory = bench, words, directory
        self._bus: FirmwareBus | None = None
        self._program: Firmware | None = None
        self._starts = 0
        self._is_due = FirmwareCommand.START not in first

    def drive(self, director: Director, last_tick: int) -> str:
        """Let the program's SYNC move time; a `ControllerError` says how it has failed."""
        tick_ns = self._bench.config.tick_ns
        session = self._bench.session
        bus = self._bus = FirmwareBus(self._bench, HUB, is_realtime=False)  # runs the first tick
        while not director.is_over and session.now < last_tick * tick_ns:
            if self._is_due:
                self._start(bus)
            if self._program is not None and self._program.is_running:
                bus.link.step()
                continue
            self._look_at_the_end()
            session.tick((), session.now + tick_ns)
        return ""

    def close(self) -> None:
        """End the program and close the bus."""
        if self._bus is not None:
            self._bus.close()

    def _obey(self, command: FirmwareCommand) -> None:
        if command is not FirmwareCommand.START and self._program is not None:
            self._program.process.kill()
            self._program.process.wait()
            self._program = None
        if command is not FirmwareCommand.KILL:
            self._is_due = True

    def _start(self, bus: FirmwareBus) -> None:
        """Start the program; a `ControllerError` says why it cannot be."""
        self._is_due = False
        self._starts += 1
        directory = self._directory / str(self._starts)
        directory.mkdir()
        self._program = bus.start(self._words, directory)

    def _look_at_the_end(self) -> None:
        """Say so where the program has ended by itself, with an error.

        Raises:
            ControllerError: it has.
        """
        program, self._program = self._program, None
        if program is not None and program.process.returncode:
            raise ControllerError(program.epitaph())


def _run_alone(bench: VirtualBench, director: Director, last_tick: int) -> None:
    """Run the ticks that are left, without a controller."""
    tick_ns = bench.config.tick_ns
    while not director.is_over and bench.session.now < last_tick * tick_ns:
        bench.bus.advance(tick_ns * 1e-9)
        for bus in bench.buses.values():
            while bus.recv(0.0):
                pass  # nobody reads it any more
