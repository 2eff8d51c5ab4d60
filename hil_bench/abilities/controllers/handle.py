"""Controllers that a test or a notebook puts on a bench by itself."""

from pathlib import Path

from hil_bench.abilities.controllers.desk import Desk, Desks
from hil_bench.abilities.controllers.kinds import read_controller
from hil_bench.abilities.controllers.power import Power
from hil_bench.abilities.controllers.section import config_of
from hil_bench.bench.virtual_bench import VirtualBench
from hil_bench.config.settings import Problems


class Handle:
    """A controller on a bench, with its switch.

    Args:
        desk: its place.
        desks: of its bench.
    """

    def __init__(self, desk: Desk, desks: Desks) -> None:
        self._desk, self._desks = desk, desks

    @property
    def is_running(self) -> bool:
        """Return True if it is on and has not come to its end."""
        return self._desk.is_running

    @property
    def ending(self) -> str:
        """Its words at its own end; empty where it did not end by itself."""
        return self._desk.ending

    def tail(self) -> str:
        """Return the end of what it has printed."""
        return self._desk.tail()

    def kill(self) -> None:
        """Take its power away."""
        self._desks.switch(self._desk, Power.KILL)

    def start(self) -> None:
        """Give it power with the next tick."""
        self._desks.switch(self._desk, Power.START)

    def restart(self) -> None:
        """Take its power away, and give it back with the next tick."""
        self._desks.switch(self._desk, Power.RESTART)


class Handles:
    """The controllers that a test puts on its bench.

    Args:
        bench: of the test.
        folder: from which their paths count.
        scratch: an empty folder.
    """

    def __init__(self, bench: VirtualBench, folder: Path, scratch: Path) -> None:
        self._bench, self._folder, self._scratch = bench, folder, scratch
        self._all: list[Desks] = []

    def put(
        self, kind: str, *, name: str = "", buses: tuple[str, ...] = (), **table: object
    ) -> Handle:
        """Put a controller on the bench; it starts with the next tick.

        A `ConfigError` says what is wrong with its table.

        Args:
            kind: of controller.
            name: of it; that of the kind without it.
            buses: that it is on; all without them.
            table: further keys of its table.
        """
        config = self._bench.config
        name = name or f"{kind}{len(self._all) or ''}"
        problems = Problems(name)
        values = {"kind": kind, **table, **({"buses": list(buses)} if buses else {})}
        chosen = read_controller("controller", values, self._folder, problems)
        problems.raise_any()
        record = chosen and config_of(name, "controller", chosen, config.buses, problems)
        problems.raise_any()
        desks = Desks([record] if record else [], self._bench.session, config, self._scratch)
        self._all.append(desks)
        return Handle(desks.desks[0], desks)

    def close(self) -> None:
        """End all, the last first."""
        for desks in reversed(self._all):
            desks.close()
