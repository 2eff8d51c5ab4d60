"""The tables ``[controllers.NAME]`` of a bench: who drives it, each on its buses."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hil_bench.abilities.common.files import scratch_folder
from hil_bench.abilities.controllers.desk import ControllerConfig, Desks
from hil_bench.abilities.controllers.kinds import Chosen, files_of, read_controller
from hil_bench.abilities.controllers.power import ONLY
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.configuration.records import Part
from hil_bench.bench.session import Session
from hil_bench.config.document import Document, read_named_sections
from hil_bench.config.settings import Problems, Settings
from hil_bench.config.values import find_nearest, quote

TABLE = "controllers"


@dataclass(frozen=True, slots=True)
class ControllersConfig(Part):
    """The controllers of a bench.

    Attributes:
        controllers: in the order of the file.
    """

    controllers: tuple[ControllerConfig, ...]

    @property
    def lines(self) -> tuple[str, ...]:
        """The lines on them at the start of a run."""
        return tuple(
            f"drive  {each.name}: {each.kind.name} on {', '.join(each.buses)}"
            for each in self.controllers
        )

    @contextmanager
    def attached(self, session: Session, config: BenchConfig) -> Iterator[Desks]:
        """Have the controllers on the buses of a session.

        Yields:
            Their desks.
        """
        with scratch_folder() as scratch:
            desks = Desks(self.controllers, session, config, scratch)
            try:
                yield desks
            finally:
                desks.close()


class ControllersSection:
    """The tables of all controllers.

    Args:
        document: the file.
        buses: the names of all buses.
        base: the folder that files are named from.
        problems: where problems are noted.
    """

    def __init__(
        self, document: Document, buses: tuple[str, ...], base: Path, problems: Problems
    ) -> None:
        self._buses, self._problems = buses, problems
        self._chosen: dict[str, Chosen] = {}
        for name, given in read_named_sections(document, TABLE, problems).items():
            if name == ONLY:
                wrong = f"{quote(name)} is the controller of a scenario; give another name"
                problems.add(problems.place(f"{TABLE}.{name}"), wrong)
            elif chosen := read_controller(f"{TABLE}.{name}", given, base, problems):
                self._chosen[name] = chosen

    def resolve(self) -> None:
        """Nothing follows from other sections."""

    def build(self) -> Mapping[str, Any]:
        """Return all controllers."""
        configs = tuple(
            config_of(name, f"{TABLE}.{name}", chosen, self._buses, self._problems)
            for name, chosen in self._chosen.items()
        )
        return {TABLE: ControllersConfig(configs)}

    def tables(self) -> Iterable[Settings]:
        """Return the tables as a person would write them."""
        return [dict(chosen.table) for chosen in self._chosen.values()]


def config_of(
    name: str, table: str, chosen: Chosen, buses: Iterable[str], problems: Problems
) -> ControllerConfig:
    """Return the record of a controller; buses that are not there are noted.

    Args:
        name: of the controller.
        table: that it was read from.
        chosen: what that says.
        buses: the names of all buses of the bench.
        problems: where they are noted.
    """
    known = tuple(buses)
    for bus in chosen.buses:
        if bus not in known:
            near = find_nearest(bus, known)
            wrong = f"{quote(bus)} is no bus of the bench; the nearest is {near}"
            problems.add(problems.place(table, "buses"), wrong)
    return ControllerConfig(
        name,
        chosen.kind,
        chosen.settings,
        chosen.buses or known,
        files_of(chosen.settings, chosen.folder),
        problems.place(table),
        chosen.folder,
    )
