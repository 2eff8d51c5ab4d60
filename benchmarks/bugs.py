"""Twelve bugs in the example in C: the kinds of controllers that show them, by scenarios alone.

    python benchmarks/bugs.py
    python benchmarks/bugs.py --only race stack_overflow --kinds elf

Each bug is a change in a copy of examples/firmware (benchmarks/bugs/bugs.toml), built for the host
and for an STM32F407. A kind shows it where one of the four scenarios of benchmarks/bugs is not
passed, in the order of the table; the first one as it is, each passes. In the last one frames come
to the chip with a jitter, and its time is short.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import occasion
from hil_bench.abilities.campaign.plan import make_spec, own_case
from hil_bench.abilities.campaign.records import RunOutcome, RunResult, RunSpec
from hil_bench.abilities.campaign.snapshot import Backend, run_pool
from hil_bench.abilities.scenario.load import load_scenario

ROOT: Final = Path(__file__).parents[1]
FOLDER: Final = ROOT / "benchmarks" / "bugs"
FIRMWARE: Final = ROOT / "examples" / "firmware"
KINDS: Final = ("library", "program", "process", "elf")
SCENARIOS: Final = ("drives", "stopped", "restarted", "endures")
TARGETS: Final = "50,-20"
MANY: Final = ",".join([TARGETS] * 8)
AS_IT_IS: Final = "as it is"
TIMEOUT: Final = 300.0  # [s]


def load_bugs() -> dict[str, Mapping[str, Any]]:
    """Return the bugs by their names, the program without one first."""
    document = tomllib.loads((FOLDER / "bugs.toml").read_text(encoding="utf-8"))
    return {AS_IT_IS: {"change": []}} | {each["id"]: each for each in document["bug"]}


def build(bug: Mapping[str, Any], folder: Path) -> None:
    """Build the firmware with a bug, for all kinds; where that fails, the program ends."""
    copy = folder / "firmware"
    shutil.copytree(FIRMWARE, copy, ignore=shutil.ignore_patterns("build", "*.py"))
    for change in bug["change"]:
        path = copy / change["file"]
        text = path.read_text(encoding="utf-8")
        if text.count(change["old"]) != 1:
            sys.exit(f"{bug['id']}: its place is {text.count(change['old'])} times in {path.name}")
        path.write_text(text.replace(change["old"], change["new"]), encoding="utf-8")
    make(bug, copy, folder, TARGETS, "position_control", "libposition_control.so", "stm32f4.elf")
    make(bug, copy, folder / "endures", MANY, "stm32f4.elf")


def make(bug: Mapping[str, Any], copy: Path, folder: Path, targets: str, *names: str) -> None:
    """Build programs of a copy of the firmware into a folder."""
    flags = ["CFLAGS=-O2 -g -Wno-error -Wno-unused", f"BUILD={folder}", f"TARGETS_MM={targets}"]
    words = ["make", "--silent", *flags, *(str(folder / name) for name in names)]
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    }
    done = subprocess.run(  # noqa: S603 - our own program
        words, cwd=copy, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        sys.exit(f"{bug.get('id', AS_IT_IS)}: does not build\n{done.stderr}")


def controller(kind: str, folder: Path, scenario: str) -> str:
    """Return the table of the controller."""
    endures = scenario == "endures"
    targets = MANY if endures else TARGETS
    words = [str(folder / "position_control"), "--bus", "{bus}", "--targets-mm", targets]
    match kind:
        case "library":
            library = f'library = "{folder}/libposition_control.so"'
            return f'{library}\nsettings = {{ targets_mm = "{targets}" }}'
        case "program":
            return f"command = {words}"
        case "process":
            return f"command = {[*words, '--lockstep']}"
        case _:
            program = folder / ("endures/stm32f4.elf" if endures else "stm32f4.elf")
            short = "jitter_us = 150\ninstructions_per_ms = 8000" if endures else ""
            return f'program = "{program}"\nchip = "STM32F407"\n{short}'


def runs(kind: str, folder: Path) -> Iterator[RunSpec]:
    """Write the scenarios for a kind.

    Yields:
        A run of each.
    """
    bench = folder / f"{kind}.bench.toml"
    tick_us = 500 if kind == "elf" else 1000
    bench.write_text(f"[bench]\ntick_us = {tick_us}\n", encoding="utf-8")
    for name in SCENARIOS:
        head = f'bench = "{bench.name}"\n'
        table = f'\n[controller]\nkind = "{kind}"\n{controller(kind, folder, name)}\n'
        path = folder / f"{kind}.{name}.scenario.toml"
        text = (FOLDER / f"{name}.toml").read_text(encoding="utf-8")
        path.write_text(head + text + table, encoding="utf-8")
        yield make_spec(own_case(load_scenario(path)), {}, {}, None, TIMEOUT)


def finding(kind: str, folder: Path, pool: Backend) -> tuple[str, str]:
    """Return the finding that shows a bug with a kind, in short and in words; empty for nothing."""
    for spec in runs(kind, folder):
        (result,) = pool([spec])
        if result.outcome is not RunOutcome.PASSED:
            return in_words(result)
    return "", ""


def in_words(result: RunResult) -> tuple[str, str]:
    """Return why a run was not passed, in short and in words."""
    missed = [each for each in result.verdicts if each.outcome != "passed"]
    if missed:
        return missed[0].id, f"{missed[0].id}: {missed[0].reason}"
    lines = [line for line in result.problem.splitlines() if line] or [result.outcome.value]
    return "ends", lines[0] if "hard fault" in lines[0] else lines[-1]


def main() -> int:
    """Print the table; return 1 where the program without a bug is not passed."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", nargs="+", metavar="ID", help="of bugs.toml")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    args = occasion.arguments(parser, only=["wrong_endianness"], kinds=["library"])
    if not (shutil.which("arm-none-eabi-gcc") and shutil.which("make") and shutil.which("cc")):
        occasion.missing("all", "there is no make, no C compiler or no arm-none-eabi-gcc")
    bugs = load_bugs()
    chosen = [AS_IT_IS, *(args.only or list(bugs)[1:])]
    print(f"| bug | {' | '.join(args.kinds)} |\n|---|{'---|' * len(args.kinds)}", flush=True)
    notes, is_sound = [], True
    for name in chosen:
        cells = []
        with tempfile.TemporaryDirectory() as place, run_pool(1) as pool:
            build(bugs[name], Path(place))
            for kind in args.kinds:
                short, words = finding(kind, Path(place), pool)
                cells.append(short or "-")
                notes += [f"{name}, {kind}: {words}"] if words else []
                is_sound &= not (name == AS_IT_IS and short)
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
    print("", *notes, sep="\n")
    return 0 if is_sound else 1


if __name__ == "__main__":
    sys.exit(main())
