"""Loading: command line, environment and file to one `BenchConfig`."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hil_bench.ability import own_tables, table_sections
from hil_bench.bench.configuration.axes import AxesSection, SuppliesSection
from hil_bench.bench.configuration.buses import BusesSection
from hil_bench.bench.configuration.loop import TABLES, LoopSection
from hil_bench.bench.configuration.nodes import needs_axis
from hil_bench.bench.configuration.nodes_section import NodesSection, Whole, warn_of_nodes
from hil_bench.bench.configuration.records import BenchConfig
from hil_bench.config.document import Sort, build_sections, check_tables, merge, read_document
from hil_bench.config.settings import Problems

CONFIG_VARIABLE = "HIL_BENCH_CONFIG"


def load_config(  # noqa: PLR0913 - one for each thing that a command line may say
    path: str | os.PathLike[str] | None = None,
    *,
    seed: int | None = None,
    interface: str | None = None,
    channel: str | int | None = None,
    bitrate: int | None = None,
    bus_options: Mapping[str, str | int | float | bool] | None = None,
    loop: Mapping[str, object] | None = None,
    tables: Mapping[str, object] | None = None,
    **given: Any,  # noqa: ANN401 - of abilities
) -> BenchConfig:
    """Return the bench that the command line, the environment and a file describe.

    An argument that is not None wins over the environment (``HIL_BENCH_CONFIG``,
    ``HIL_BENCH_SEED``), which wins over the file, which wins over the default. Whatever is wrong
    comes as one `ConfigError`, a line a problem: ``file:table.key: what is wrong; what would be
    right``. What is wrong in an EDS file, and costs a part of its device, is logged as a warning.

    Args:
        path: `bench.toml`; without it and ``HIL_BENCH_CONFIG``, the built-in bench of one axis.
        seed: seed of every random generator of the bench.
        interface: python-can's name of the interface; further keys of ``[bus]``, which are for the
            file's interface, then lapse.
        channel: the channel of that interface.
        bitrate: bit rate [bit/s].
        bus_options: further keyword arguments of that interface's bus class.
        loop: keys of ``[bench]`` that say what makes the ticks, such as ``realtime``.
        tables: tables as the file has them, nested; their keys win over the file's.
        given: by the name of an ability's table, True for one with its defaults where the file has
            none, as in ``modbus=True``, or a list of tables that come to those of the file, as in
            ``faults=[{"kind": "freeze", "target": "pressure_a"}]``.

    Raises:
        TypeError: no ability has a table of such a name, or it takes no list.
    """
    if unknown := sorted(given.keys() - own_tables().keys()):
        raise TypeError(f"load_config() got an unexpected keyword argument '{unknown[0]}'")

    file = _choose_file(path)
    document = merge(read_document(file, Sort.BENCH) if file else {}, tables or {})
    document = {**{name: {} for name, value in given.items() if value is True}, **document}
    problems = Problems(str(file) if file else "built-in bench")
    special = table_sections([name for name in document if name not in TABLES])
    check_tables(document, (*TABLES, *own_tables(), *special), problems)
    base = file.parent if file else Path()
    on_bus = {"interface": interface, "channel": channel, "bitrate": bitrate}
    bench = LoopSection(document, {"seed": seed, **(loop or {})}, problems)
    buses = BusesSection(document, on_bus | dict(bus_options or {}), problems)
    supplies = SuppliesSection(document, bench, problems)
    ahead = {name: make for name, make in special.items() if getattr(make, "before_nodes", False)}
    default = needs_axis(document, [make.needs_axis(document) for make in ahead.values()])
    axes = AxesSection(document, bench, supplies, base, problems, default=default)
    peers = {name: make(document, axes, base, problems) for name, make in ahead.items()}
    nodes = NodesSection(document, buses, axes, peers, base, problems)
    behind_nodes = {
        name: make(document, buses.names, base, problems, nodes.nodes)
        for name, make in special.items()
        if getattr(make, "of_nodes", False)
    }
    whole = Whole(axes, buses, nodes, peers, given)
    of_bench = {
        name: make(document, whole, problems)
        for name, make in special.items()
        if getattr(make, "of_bench", False)
    }
    for name, value in given.items():
        if not isinstance(value, bool) and name not in of_bench:
            raise TypeError(f"load_config() takes True or False for '{name}', not {value!r}")
    others = {
        name: make(document, buses.names, base, problems)
        for name, make in special.items()
        if name not in {*ahead, *behind_nodes, *of_bench}
    }
    own = (bench, buses, supplies, axes, *peers.values(), nodes)
    sections = (*own, *behind_nodes.values(), *of_bench.values(), *others.values())
    found = build_sections(sections, problems)
    warn_of_nodes(nodes.nodes)
    built = tuple(found.pop(name) for name in (*peers, *behind_nodes, *others, *of_bench))
    return BenchConfig(path=file, parts=built, **found)


def _choose_file(path: str | os.PathLike[str] | None) -> Path | None:
    chosen = path or os.environ.get(CONFIG_VARIABLE)
    return Path(chosen) if chosen else None
