"""`hil-bench doctor`: what the machine and its software can do."""

import argparse
import importlib.metadata
import json
import logging
import os
import platform
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

from hil_bench import __version__
from hil_bench.abilities.common.progress import Work, shown_work
from hil_bench.abilities.doctor.machine import (
    IS_LINUX,
    Finding,
    LatenessTest,
    Read,
    Topic,
    Verdict,
    absent,
    examine_machine,
    examine_permissions,
    good,
    judged,
    measure_lateness,
    read_file,
)
from hil_bench.ability import abilities, load, own_abilities
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.compiled import HOW, Core, look_at_core
from hil_bench.bench.configuration import RealtimePolicy, load_config
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import add_json_argument
from hil_bench.devices.kinds.registry import KINDS
from hil_bench.errors import ConfigError
from hil_bench.outside.bits import bitrate_text
from hil_bench.outside.realtime.clock import MonotonicClock
from hil_bench.outside.transports.socketcan import (
    RECEIVE_BUFFER,
    CanInterface,
    can_interfaces,
    has_socketcan,
)
from hil_bench.plants.hydraulic_cylinder.model.implicit_midpoint import advance_implicit_midpoint
from hil_bench.plants.hydraulic_cylinder.model.kernel import IS_COMPILED, ready
from hil_bench.plants.hydraulic_cylinder.model.machine_code import WANTS_PYTHON, find_machine_code
from hil_bench.plants.hydraulic_cylinder.model.moving import describe_kernels
from hil_bench.plants.registry import PLANTS
from hil_bench.registry import Extension, Registry

logger = logging.getLogger(__name__)

# The software: versions, buses, and extensions of other distributions.


# Python and the libraries.

_LIBRARIES = ("numpy", "python-can", "canopen")
_INTERPRETED = "the plant takes 57 us of a tick in place of 2"


def examine_software() -> Topic:
    """Return the findings on Python and the libraries; a bench has been built before."""
    versions = [f"{name} {importlib.metadata.version(name)}" for name in _LIBRARIES]
    return Topic(
        "Software",
        (
            good("Python", f"{platform.python_version()} ({sys.executable})"),
            good("libraries", ", ".join(versions)),
            _core(look_at_core()),
            _kernel(),
        ),
    )


def _core(core: Core) -> Finding:
    name = "core of the bench"
    if not core.compiler:
        return Finding(name, Verdict.HINT, str(core), HOW)
    if core.edited:
        return Finding(name, Verdict.HINT, str(core), "install again, or pip install -e a checkout")
    return good(name, str(core))


def _kernel() -> Finding:
    name, what = "plant kernel", describe_kernels()
    if find_machine_code().bind is not None:
        return good(name, what)
    if not IS_COMPILED:
        remedy = "unset NUMBA_DISABLE_JIT" if WANTS_PYTHON else "pip install 'hil-bench[fast]'"
        return Finding(name, Verdict.HINT, what, f"{remedy}; {_INTERPRETED}")
    if find_machine_code().refusal:
        return Finding(name, Verdict.HINT, what, "each start imports Numba, which takes 0.7 s")
    statistics: Any = ready(advance_implicit_midpoint).stats  # type: ignore[attr-defined]  # Numba's
    version = f"{what} {importlib.metadata.version('numba')}"
    if statistics.cache_path is None:
        advice = "NUMBA_CACHE_DIR=DIR names a directory of yours, or each start compiles for 1 s"
        return Finding(name, Verdict.HINT, f"{version}, nowhere to cache it", advice)
    how = "cached" if statistics.cache_hits else "cached now"
    return good(name, f"{version}, {how} in {statistics.cache_path}")


# Extensions by other distributions: kinds of devices and of plants, and abilities.


def examine_extensions() -> Topic:
    """The kinds and abilities that are installed besides the bench's own; each is imported."""
    findings = [_kind("kind of device", extension) for extension in KINDS.extensions()]
    findings += [_kind("kind of plant", extension) for extension in PLANTS.extensions()]
    for ability in own_abilities():
        for what, place in ability.registries.items():
            registry = cast("Registry[object]", load(place))
            findings += [_kind(what, extension) for extension in registry.extensions()]
    findings += [_kind("ability", extension) for extension in abilities().extensions()]
    return Topic("Extensions", tuple(findings or [absent("kinds", "none installed")]))


def _kind(what: str, extension: Extension) -> Finding:
    value = f"{what}, {extension.distribution}"
    if extension.problem:
        return Finding(extension.name, Verdict.MISSING, f"{value}, not loaded", extension.problem)
    return good(extension.name, value)


# CAN on this machine.

_HUB = "'hil-bench run --hub' makes a bus without it"
_MODULES = ("/lib/modules", "/usr/lib/modules")


def examine_buses(read: Read) -> Topic:
    """Return the findings on CAN buses.

    Args:
        read: reads files of the kernel.
    """
    if not IS_LINUX:
        return Topic("CAN", (Finding("SocketCAN", Verdict.ABSENT, "Linux only", _HUB),))
    if not has_socketcan():
        advice = f"'modprobe can-raw' (root) where the kernel has the module; else {_HUB}"
        return Topic("CAN", (Finding("SocketCAN", Verdict.MISSING, "no AF_CAN", advice),))
    interfaces = can_interfaces()
    findings = [good("SocketCAN", "AF_CAN"), _vcan(read, interfaces), _receive_buffer(read)]
    findings += [_interface(interface) for interface in interfaces]
    if not interfaces:
        advice = "'ip link add dev vcan0 type vcan && ip link set vcan0 up' (root) makes one"
        findings.append(Finding("interfaces", Verdict.HINT, "none", advice))
    return Topic("CAN", tuple(findings))


def _vcan(read: Read, interfaces: list[CanInterface]) -> Finding:
    if any(interface.kind == "vcan" for interface in interfaces):
        return good("vcan", "in use")
    if Path("/sys/module/vcan").exists():
        return good("vcan", "loaded")
    if _has_module(read):
        return good("vcan", "there, 'modprobe vcan' (root) loads it")
    return Finding("vcan", Verdict.HINT, "no such module found", _HUB)


def _has_module(read: Read) -> bool:
    folders = [f"{root}/{platform.release()}" for root in _MODULES]
    names = ("modules.builtin", "modules.dep")
    return any("/vcan.ko" in read(f"{folder}/{name}") for folder in folders for name in names)


def _receive_buffer(read: Read) -> Finding:
    most = read("/proc/sys/net/core/rmem_max")
    if not most.isdigit():
        return absent("receive buffer", "unknown")
    return judged(
        "receive buffer",
        f"up to {int(most) // 1024} KiB; CAP_NET_ADMIN needs no limit",
        f"'sysctl -w net.core.rmem_max={RECEIVE_BUFFER}', or a flood may lose frames",
        is_good=int(most) >= RECEIVE_BUFFER,
    )


def _interface(interface: CanInterface) -> Finding:
    rate = f", {bitrate_text(interface.bitrate)}" if interface.bitrate else ""
    value = f"{interface.kind or 'CAN'}, {'up' if interface.is_up else 'down'}{rate}"
    start = f"'ip link set {interface.name} up"
    if interface.kind == "can" and not interface.bitrate:
        start += " type can bitrate 500000"
    return judged(interface.name, value, f"{start}'", is_good=interface.is_up)


# `hil-bench doctor`: what this machine can do for a bench, and what to change.


_LONG = 10.0  # for those who wait and see nothing [s]
_LONGEST = 3600.0
_MARKS = {Verdict.GOOD: "ok", Verdict.HINT: "hint", Verdict.MISSING: "no", Verdict.ABSENT: "-"}
_COLOURS = {"ok": "\x1b[32m", "hint": "\x1b[33m", "no": "\x1b[31m", "-": "\x1b[2m"}
_RESET, _BOLD = "\x1b[0m", "\x1b[1m"
_POLICIES = {"SCHED_FIFO": RealtimePolicy.FIFO, "SCHED_DEADLINE": RealtimePolicy.DEADLINE}

_EXAMPLES = """\
examples:
  hil-bench doctor
  hil-bench doctor --seconds 60        a longer test of the lateness
  hil-bench doctor --json
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "doctor",
        description="Show what this machine can do for a bench in real time: permissions, kernel,\n"
        "processors, CAN, software, installed kinds of devices and plants, the lateness of a\n"
        "short run; and what to change. Nothing is changed.",
        epilog=_EXAMPLES,
    )
    add_json_argument(parser)
    parser.add_argument(
        "--seconds",
        type=float,
        default=2.0,
        metavar="S",
        help="measure the lateness for S seconds (default: 2); 0 for not at all",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Look at everything, measure, print it.

    Raises:
        ConfigError: the length of the test makes no sense.
    """
    if not 0 <= args.seconds <= _LONGEST:
        raise ConfigError(f"--seconds {args.seconds:g}: give 0 to {_LONGEST:g} s")
    permissions, machine = examine_permissions(read_file), examine_machine(read_file)
    buses = examine_buses(read_file)
    tests = measure(args, permissions)
    topics = (permissions, machine, buses, examine_software(), examine_extensions())
    if args.json:
        print(json.dumps(found_content(topics, tests), indent=2))
    elif not args.quiet:
        is_coloured = sys.stdout.isatty() and not os.environ.get("NO_COLOR")
        print(*report_lines(topics, tests, is_coloured=is_coloured), sep="\n", flush=True)
    return ExitCode.DONE


def measure(args: argparse.Namespace, permissions: Topic) -> list[LatenessTest]:
    """Return the lateness without a policy and with those that are permitted.

    Args:
        args: the command line, with `seconds` and `quiet`.
        permissions: what this process may do.
    """
    permitted = {item.name for item in permissions.findings if item.verdict is Verdict.GOOD}
    policies = [policy for name, policy in _POLICIES.items() if name in permitted]
    config = load_config()
    with shown_work(args, Work("plant")) as work:
        work.begin("its kernels are compiled where no cache has them")
        build_bench(config)
    if not args.seconds:
        return []
    if args.seconds >= _LONG:  # once, for a thread that says it again would be measured, too
        logger.warning("the lateness is measured for %g s", args.seconds)
    return measure_lateness(config, args.seconds, [RealtimePolicy.OFF, *policies], MonotonicClock())


def found_content(topics: Sequence[Topic], tests: Sequence[LatenessTest]) -> dict[str, object]:
    """Return all of it for a program."""
    return {
        "version": __version__,
        "system": platform.platform(),
        "findings": [
            {"topic": topic.name, **asdict(finding)}
            for topic in topics
            for finding in topic.findings
        ],
        "lateness": [{"name": test.name, **asdict(test.summary)} for test in tests],
    }


def report_lines(
    topics: Sequence[Topic], tests: Sequence[LatenessTest], *, is_coloured: bool
) -> Iterator[str]:
    """Yield the report for people.

    Yields:
        Its lines.
    """

    def paint(text: str, colour: str) -> str:
        return f"{colour}{text}{_RESET}" if is_coloured else text

    yield f"hil-bench {__version__} on {platform.platform()}"
    width = max(len(finding.name) for topic in topics for finding in topic.findings)
    for topic in topics:
        yield ""
        yield paint(topic.name, _BOLD)
        for finding in topic.findings:
            mark = _MARKS[finding.verdict]
            painted = paint(f"{mark:4}", _COLOURS[mark])
            yield f"  {painted}  {finding.name:{width}}  {finding.value}"
            if finding.advice:
                yield f"  {'':{width + 6}}  {paint('->', _COLOURS[mark])} {finding.advice}"
    if tests:
        yield ""
        yield paint(f"Lateness at 1 kHz, {tests[0].summary.ticks} ticks each [us]", _BOLD)
        yield from lateness_lines(tests)


def lateness_lines(tests: Iterable[LatenessTest]) -> Iterator[str]:
    """Yield the table of the measured lateness.

    Yields:
        Its lines.
    """
    yield f"  {'':24}{'p50':>8}{'p99':>8}{'p99.9':>8}{'max':>8}{'overruns':>10}"
    for test in tests:
        late = test.summary.lateness
        figures = (late.p50_us, late.p99_us, late.p999_us, late.max_us)
        columns = "".join(f"{figure:8.0f}" for figure in figures)
        yield f"  {test.name:24}{columns}{test.summary.overruns:10}"
