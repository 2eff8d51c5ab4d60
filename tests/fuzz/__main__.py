"""Coverage-guided fuzzing of every parser, by atheris: ``python tests/fuzz [TARGET ...]``.

Each target runs in a process of its own, one a processor, from its corpus in
``tests/fuzz/corpus``. An input that breaks one is kept in ``--found`` and replayed with
``--replay FILE``; put it into the corpus once it is mended. With ``--keep`` inputs that reach new
code go into the corpus.
"""

import argparse
import importlib
import os
import pkgutil
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
CORPUS = HERE / "corpus"
# Module, target, and the inputs that an idle processor takes in about five seconds.
MODULES = {
    "file_targets": {
        "eds": 2_000,
        "bench_toml": 5_000,
        "register_map": 8_000,
        "mdf": 15_000,
        "signals_csv": 15_000,
        "frames": 11_000,
        "stored_parameters": 25_000,
    },
    "device_targets": {"node": 500, "unconfigured_node": 550, "bench": 125, "ecus": 500},
    "bus_targets": {
        "sdo_client": 9_500,
        "valve_driver": 250,
        "scan": 25_000,
        "twin_decoder": 30_000,
        "modbus_client": 11_000,
        "hub": 17_500,
    },
    "modbus_targets": {"modbus_tcp": 7_500, "modbus_rtu": 14_500},
}
TARGETS = {name: module for module, names in MODULES.items() for name in names}
INPUTS = {name: count for names in MODULES.values() for name, count in names.items()}
SLOWEST = 20  # s for one input: a hang
LARGEST = 2048  # MB of memory
WORD = re.compile(rb"\b[A-Za-z_][A-Za-z0-9_]{2,30}\b")
MOST_WORDS = 400


def main() -> int:
    """Return 0 where no input broke a target."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=", ".join(TARGETS))
    parser.add_argument("--seconds", type=float, default=120.0, help="for all together (120)")
    parser.add_argument(
        "--repeatable",
        action="store_true",
        help="a fixed number of inputs a target: the same code gets the same inputs on any machine",
    )
    parser.add_argument("--found", type=Path, default=Path("fuzz-found"), help="(fuzz-found)")
    parser.add_argument("--keep", action="store_true", help="keep new inputs in the corpus")
    parser.add_argument("--replay", type=Path, metavar="FILE", help="give one target one input")
    parser.add_argument("--child", nargs=argparse.REMAINDER, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if unknown := set(arguments.targets) - set(TARGETS):
        parser.error(f"no target {', '.join(sorted(unknown))}; there are {', '.join(TARGETS)}")
    targets = arguments.targets or list(TARGETS)
    if arguments.child is not None:
        return fuzz(targets[0], arguments.child)
    if arguments.replay:
        load(targets[0])(arguments.replay.read_bytes())
        return 0
    arguments.found.mkdir(parents=True, exist_ok=True)
    processes = min(len(os.sched_getaffinity(0)), len(targets))
    seconds = max(1, round(arguments.seconds * processes / len(targets)))
    with ThreadPoolExecutor(processes) as pool:
        results = list(
            pool.map(
                lambda name: run(
                    name, _end(arguments, name, seconds), arguments.found, keep=arguments.keep
                ),
                targets,
            )
        )
    return max(results)


def _end(arguments: argparse.Namespace, target: str, seconds: int) -> str:
    """Return the option of libFuzzer that ends a target."""
    return f"-runs={INPUTS[target]}" if arguments.repeatable else f"-max_total_time={seconds}"


def load(target: str):
    """Return a target's function."""
    return getattr(importlib.import_module(f"fuzz.{TARGETS[target]}"), target)


def fuzz(target: str, options: list[str]) -> int:
    """Run atheris in this process; it ends the process."""
    import atheris  # noqa: PLC0415 - only where it is needed

    import hil_bench.plants.hydraulic_cylinder.model  # noqa: PLC0415 - likewise

    for module in pkgutil.iter_modules(
        hil_bench.plants.hydraulic_cylinder.model.__path__,
        "hil_bench.plants.hydraulic_cylinder.model.",
    ):
        importlib.import_module(module.name)  # as it is: Numba compiles it
    with atheris.instrument_imports(include=["hil_bench", "hil_drivers"]):
        one_input = load(target)
    one_input(b"")  # compiles what it needs, outside the time of an input
    atheris.Setup([target, *options], one_input)
    atheris.Fuzz()
    return 0


def dictionary(corpus: Path, file: Path) -> list[str]:
    """Write the words of a corpus as libFuzzer takes them; return its option, if there are some."""
    words = {word for path in corpus.iterdir() for word in WORD.findall(path.read_bytes())}
    lines = [f'"{word.decode()}"\n' for word in sorted(words)[:MOST_WORDS]]
    file.write_text("".join(lines), encoding="ascii")
    return [f"-dict={file}"] if lines else []


def run(target: str, end: str, found: Path, *, keep: bool) -> int:
    """Fuzz one target in a process of its own; say in one line what came of it."""
    kept = CORPUS / target
    kept.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as scratch:
        fresh = Path(scratch, "corpus")
        fresh.mkdir()
        corpora = [str(kept)] if keep else [str(fresh), str(kept)]
        options = [
            *dictionary(kept, Path(scratch, "words.dict")),
            *(end, "-seed=1", "-print_final_stats=1"),
            *(
                f"-timeout={SLOWEST}",
                f"-rss_limit_mb={LARGEST}",
                f"-artifact_prefix={found}/{target}-",
            ),
            *corpora,
        ]
        command = [sys.executable, str(HERE), target, "--child", *options]
        ended = subprocess.run(  # noqa: S603 - ourselves
            command,
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
            env=os.environ | {"PYTHONHASHSEED": "0"},
        )
    said = ended.stdout + ended.stderr
    inputs = re.search(r"number_of_executed_units:\s*(\d+)", said)
    covered = re.findall(r"cov: (\d+)", said)
    count, edges = inputs[1] if inputs else "?", covered[-1] if covered else "?"
    verdict = "BROKEN" if ended.returncode else "ok"
    print(f"{target:18} {count:>8} inputs, {edges:>6} edges, {verdict}", flush=True)
    if ended.returncode:
        print(said[-6000:], flush=True)
    return 1 if ended.returncode else 0


if __name__ == "__main__":
    sys.exit(main())
