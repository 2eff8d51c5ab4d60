"""An ability of the bench: all that it can do beside running a plant behind its devices.

An ability is a package that declares itself by an `Ability`. The core looks through them, and
names none of them. Those of the bench are the packages of `hil_bench.abilities` that `OWN` lists;
other distributions declare theirs as entry points of the group `hil_bench.abilities`. See
docs/abilities.md.
"""

from collections.abc import Iterable, Mapping
from functools import cache
from importlib import import_module
from types import MappingProxyType, ModuleType
from typing import Any, NamedTuple

from hil_bench.registry import Registry

OWN = (
    "analysis",
    "bench_fixtures",
    "campaign",
    "commissioning",
    "conformance",
    "controllers",
    "copper",
    "demo",
    "doctor",
    "download",
    "drive",
    "evidence",
    "eyes",
    "faults",
    "fmu",
    "hub",
    "identification",
    "j1939",
    "live",
    "lockstep",
    "modbus",
    "new",
    "panel",
    "recording",
    "replay",
    "scenario",
    "shadow",
    "srdo",
)
"""The abilities of the bench, each a package of `hil_bench.abilities`."""

GROUPS = ("start", "run", "test", "bus", "machine", "more")
"""The groups of verbs, as the help shows them."""


class Verb(NamedTuple):
    """A verb of the command line.

    Attributes:
        group: one of `GROUPS`.
        place: in its group, from the top.
        summary: its line in the help.
        module: has ``add_parser(subparsers)`` and ``run(args) -> int``; imported when it is called.
    """

    group: str
    place: int
    summary: str
    module: str


_NOTHING: Mapping[str, str] = MappingProxyType({})


class Ability(NamedTuple):
    """A package's declaration of what it adds to the bench.

    It has names only, so that nothing else of the package is imported before use.

    Attributes:
        name: by which other abilities need it.
        needs: the abilities that it imports.
        verbs: of the command line, by name.
        options: what it adds to verbs of others: modules by verb, each with
            ``add_options(parser, often)``; often is the group of the options that are most used, or
            the parser. What else it may have: ``check_options(args)`` refuses what cannot be meant;
            ``take_over(args, *known) -> int | None`` runs the verb where one of the options asks
            for it, and returns None where none does; known is what the verb has read by then: the
            `BenchConfig` of ``check``; ``EXAMPLES`` are lines for the ends of helps, by verb.
        collectors: of the pytest plugin: ``module:class`` by the end of the names of the files
            that it makes tests of.
        frame_reader: ``module:class`` that reads the frames of a bench in words, for the reports of
            failed tests.
        tables: of ``bench.toml``: ``module:class`` by name, of the `Section` that reads it. It is
            made with the document, the names of all buses, the folder of the file and the problems,
            and builds a `Part` by the table's name. One whose class says ``of_nodes = True`` is
            made with the tables of the nodes, too, and stands behind them in ``check``. One of
            devices beside the nodes says ``before_nodes = True``; it is made with the document, the
            section of the axes, the folder and the problems, and is a
            `hil_bench.bench.configuration.nodes.PeerSection`. One that is about all of the bench
            says ``of_bench = True``; it is made with the document, a
            `hil_bench.bench.configuration.nodes_section.Whole` and the problems.
        standing: those of `tables` whose section is made for a file without the table, too.
        bus_tables: of a bus, as ``[bus.wire]``: ``module:function`` by name, that reads one as a
            `hil_bench.bench.configuration.buses.BusTable`.
        bench_methods: of `hil_bench.VirtualBench`: ``module:function`` by name, of a function that
            gets the bench first.
        bench_attributes: of it, too: ``module:function`` by name, of a function that returns the
            attribute of a bench.
        gives: modules for others by the name of who takes them: an ability, which need not be there
            and alone imports its module, or a part of the core. docs/abilities.md has them all.
        fixtures: a plugin of pytest with fixtures, options, hooks; imported in each of its runs.
        registries: ``module:registry`` by what it has, as in "kind of controller"; for `doctor`.
        exports: names that ``hil_bench`` exports, and the modules that have them.
    """

    name: str
    needs: tuple[str, ...] = ()
    verbs: Mapping[str, Verb] = MappingProxyType({})
    options: Mapping[str, str] = _NOTHING
    collectors: Mapping[str, str] = _NOTHING
    frame_reader: str = ""
    tables: Mapping[str, str] = _NOTHING
    standing: tuple[str, ...] = ()
    bus_tables: Mapping[str, str] = _NOTHING
    bench_methods: Mapping[str, str] = _NOTHING
    bench_attributes: Mapping[str, str] = _NOTHING
    gives: Mapping[str, str] = _NOTHING
    fixtures: str = ""
    registries: Mapping[str, str] = _NOTHING
    exports: Mapping[str, str] = _NOTHING


@cache
def own_abilities() -> tuple[Ability, ...]:
    """The abilities of the bench itself."""
    return tuple(import_module(f"hil_bench.abilities.{name}").ABILITY for name in OWN)


def given_to(taker: str) -> list[ModuleType]:
    """The modules that abilities give to another one, or to a part of the core."""
    return [import_module(each.gives[taker]) for each in own_abilities() if taker in each.gives]


def own_tables() -> dict[str, str]:
    """The places of the sections that read tables of ``bench.toml``, by the tables' names."""
    return {name: place for each in own_abilities() for name, place in each.tables.items()}


def bus_tables() -> dict[str, Any]:
    """The readers of tables of a bus, by the tables' names; imported where a file has one."""
    places = {name: place for each in own_abilities() for name, place in each.bus_tables.items()}
    return {name: load(place) for name, place in places.items()}


def table_sections(names: Iterable[str]) -> dict[str, Any]:
    """The sections that read tables of ``bench.toml``, by the tables' names, standing ones last.

    Other distributions are asked only for a name that no ability of the bench has.

    Args:
        names: of the tables that a file has, beside those of the core.
    """
    own = own_tables()
    wanted = [name for name in names if name not in own]
    others = other_abilities()[0] if wanted else []
    known = own | {name: place for each in others for name, place in each.tables.items()}
    standing = [name for each in own_abilities() for name in each.standing]
    return {name: load(known[name]) for name in dict.fromkeys([*names, *standing]) if name in known}


def load(place: str) -> object:
    """The object that ``module:name`` stands for."""
    module, _, name = place.partition(":")
    found: object = getattr(import_module(module), name)
    return found


def other_abilities() -> tuple[list[Ability], list[str]]:
    """The abilities of other distributions, and a line for each that cannot be used."""
    registry = abilities()
    usable, problems = [], []
    for extension in registry.extensions():
        if extension.problem:
            problems.append(extension.problem)
        elif found := registry.find(extension.name):
            usable.append(found)
    return usable, problems


def abilities() -> Registry[Ability]:
    """All abilities by name."""
    own = {ability.name: ability for ability in own_abilities()}
    return Registry("hil_bench.abilities", Ability, own, _find_fault)


def _find_fault(ability: Ability) -> str:
    """The fault of an ability from elsewhere; empty where there is none."""
    for name in Ability._fields:
        if name not in {"name", "needs", "verbs", "tables"} and getattr(ability, name):
            return f"has {name}; of other distributions only verbs and tables are taken"
    for name, verb in ability.verbs.items():
        if verb.group not in GROUPS:
            right = ", ".join(GROUPS)
            return f'puts its verb {name} into the group "{verb.group}"; one of {right} is right'
    missing = [name for name in ability.needs if name not in OWN]
    return f"needs {missing[0]}, which hil-bench does not have" if missing else ""
