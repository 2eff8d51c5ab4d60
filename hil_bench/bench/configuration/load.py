"""Loading: command line, environment and file to one `BenchConfig`."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from hil_bench.bench.configuration.axes import build_axes, check_axes, read_axes
from hil_bench.bench.configuration.bindings import build_bindings, read_bindings
from hil_bench.bench.configuration.buses import build_bus, check_buses, read_bus, read_further_buses
from hil_bench.bench.configuration.eds_findings import warn_of_nodes
from hil_bench.bench.configuration.faults import (
    build_fault,
    check_defects,
    check_faults,
    find_targets,
    read_faults,
)
from hil_bench.bench.configuration.keys import BENCH_KEYS, LOOP_KEYS, REALTIME_KEYS, TABLES
from hil_bench.bench.configuration.modbus import (
    ModbusSettings,
    build_modbus,
    read_modbus,
    resolve_modbus,
)
from hil_bench.bench.configuration.nodes import (
    build_node,
    check_nodes,
    needs_axis,
    read_nodes,
    resolve_nodes,
)
from hil_bench.bench.configuration.records import BenchConfig
from hil_bench.bench.configuration.scripts import read_scripts
from hil_bench.config.document import Document, check_tables, merge, read_document, read_section
from hil_bench.config.settings import (
    Given,
    Origin,
    Problems,
    Settings,
    convert,
    read_table,
)
from hil_bench.kinds.chains import check_chains
from hil_bench.outside.realtime.policy import RealtimeConfig, RealtimePolicy

CONFIG_VARIABLE = "HIL_BENCH_CONFIG"
SEED_VARIABLE = "HIL_BENCH_SEED"


def load_config(  # noqa: PLR0913 - one for each thing that a command line may say
    path: str | os.PathLike[str] | None = None,
    *,
    seed: int | None = None,
    interface: str | None = None,
    channel: str | int | None = None,
    bitrate: int | None = None,
    bus_options: Mapping[str, str | int | float | bool] | None = None,
    loop: Mapping[str, object] | None = None,
    modbus: bool = False,
    faults: Sequence[Mapping[str, object]] = (),
    tables: Mapping[str, object] | None = None,
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
        modbus: serve Modbus even where the file has no ``[modbus]``.
        faults: tables of ``[[faults]]``, which come to those of the file.
        tables: tables as the file has them, nested; their keys win over the file's.
    """
    file = _choose_file(path)
    document = merge(read_document(file) if file else {}, tables or {})
    problems = Problems(str(file) if file else "built-in bench")
    check_tables(document, TABLES, problems)
    bench = _read_bench(document, {"seed": seed, **(loop or {})}, problems)
    overrides = {"interface": interface, "channel": channel, "bitrate": bitrate}
    bus = read_bus(document, overrides | dict(bus_options or {}), problems)
    further = read_further_buses(document, problems)
    axes = read_axes(document, problems, default=needs_axis(document))
    nodes, chains = read_nodes(document, axes, problems)
    given = read_bindings(nodes, axes, problems)
    scripts = read_scripts(nodes, problems)
    served = read_modbus(document, nodes, problems, wanted=modbus)
    read = read_faults(document, faults, problems)
    if not nodes:
        problems.add(problems.place("nodes"), "the bench has none; give one as [nodes.NAME]")
    problems.raise_any()

    _check_timing(bench, problems)
    check_axes(axes, problems)
    resolve_nodes(nodes, axes, file.parent if file else Path(), problems)
    bindings = build_bindings(given, nodes, axes, problems)
    check_chains(chains, problems)
    check_buses(bus, further, nodes, problems)
    check_nodes(nodes, axes, bindings, problems)
    if served:
        resolve_modbus(served, nodes, file.parent if file else Path(), problems)
    check_faults(read, find_targets(nodes, axes, bindings), problems)
    built_axes = build_axes(axes, bench["step_us"].value, problems)
    check_defects(read, built_axes, problems)
    problems.raise_any()
    built_modbus = build_modbus(served, nodes, problems) if served else None
    problems.raise_any()
    warn_of_nodes(nodes)

    members = [table for name in nodes for table in (nodes[name], chains.get(name, {}))]
    plants = [axis.settings for axis in axes.values()]
    used = (bench, bus, *further.values(), *plants, *members, *_tables(served), *read)
    return BenchConfig(
        path=file,
        **convert(bench, LOOP_KEYS),
        bus=build_bus(bus),
        further_buses={name: build_bus(table) for name, table in further.items()},
        axes=built_axes,
        nodes=tuple(
            build_node(name, node, bindings[name], scripts[name], chains.get(name), problems)
            for name, node in nodes.items()
        ),
        modbus=built_modbus,
        settings=tuple(setting for table in used for setting in table.values()),
        realtime=RealtimeConfig(**convert(bench, REALTIME_KEYS)),
        faults=tuple(build_fault(fault) for fault in read),
    )


def _choose_file(path: str | os.PathLike[str] | None) -> Path | None:
    chosen = path or os.environ.get(CONFIG_VARIABLE)
    return Path(chosen) if chosen else None


def _read_bench(
    document: Document, overrides: Mapping[str, object], problems: Problems
) -> Settings:
    given = read_section(document, "bench", problems)
    if text := os.environ.get(SEED_VARIABLE):
        value = int(text) if text.isascii() and text.isdecimal() else text
        given["seed"] = Given(value, Origin.ENVIRONMENT, f"environment:{SEED_VARIABLE}")
    for key, override in overrides.items():
        if override is not None:
            given[key] = Given(override, Origin.COMMAND_LINE, f"--{key.replace('_', '-')}")
    return read_table("bench", given, BENCH_KEYS, problems)


def _tables(modbus: ModbusSettings | None) -> tuple[Settings, ...]:
    return (modbus.server, *modbus.units.values()) if modbus else ()


def _check_timing(bench: Settings, problems: Problems) -> None:
    if bench["sync_period_us"].value is None:
        bench["sync_period_us"] = bench["sync_period_us"]._replace(value=bench["tick_us"].value)
    for key, divisor in (("tick_us", "step_us"), ("sync_period_us", "tick_us")):
        if wrong := _no_multiple(bench[key].value, divisor, bench[divisor].value):
            is_option = bench[key].origin is Origin.COMMAND_LINE
            place = f"--{key.replace('_', '-')}" if is_option else problems.place("bench", key)
            problems.add(place, wrong)
    policy, cpu = bench["realtime"].value, bench["realtime_cpu"].value
    if policy is RealtimePolicy.DEADLINE and cpu is not None:
        wrong = f'{cpu} with realtime = "deadline", which Linux ties to no processor'
        right = 'leave realtime_cpu out, or give realtime = "fifo"'
        problems.add(problems.place("bench", "realtime_cpu"), f"{wrong}; {right}")


def _no_multiple(value: int, divisor: str, step: int) -> str:
    """Return what is wrong and what would be right; nothing where the value is a multiple."""
    if not value % step:
        return ""
    below, above = value // step * step, (value // step + 1) * step
    right = f"give {below} or {above}" if below else f"give {above}"
    return f"{value} is not a multiple of {divisor} = {step}; {right}"
