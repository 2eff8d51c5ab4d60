"""The default solver against a reference, on manoeuvres drawn at random.

    python benchmarks/accuracy.py                     # about four minutes
    python benchmarks/accuracy.py --before f849b11    # beside an older revision, in turns

Each of ten kinds has the same share: steps, sines, ramps through standstill, creeping reversals,
loads, overloads, leakage, a mixture, the mixture on another machine, and the mixture on a machine
with one extension. The reference is the plant's Runge-Kutta method with steps of 1 us. It is
checked twice: against itself with steps of 2 us, and against SciPy's LSODA on the equations that
`benchmarks/solvers.py` writes out (the paper's options, in which the two share no code).
"""

import argparse
import io
import json
import os
import subprocess
import sys
import tarfile
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

import occasion
from hil_bench.abilities.common import figure_style
from hil_bench.plants.hydraulic_cylinder.model import PlantOptions, Solver, balanced_state
from hil_bench.plants.hydraulic_cylinder.model.stepping import DEFAULT_STEP
from manoeuvres import Run, draw, positions
from solvers import reference

Array = npt.NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[1]
FINE, COARSE = 1e-6, 2e-6
CHECKED = 8
"""Manoeuvres on which the reference is compared with LSODA: one of each of the first kinds."""


def check_reference(seed: int) -> float:
    """Return the largest deviation of the reference from LSODA [um]."""
    worst = 0.0
    for number in range(CHECKED):
        manoeuvre = draw(seed, number)._replace(options=PlantOptions.paper())
        p = manoeuvre.parameters
        moves = [
            (float(u), float(F_L), 1) for u, F_L in zip(manoeuvre.u, manoeuvre.F_L, strict=True)
        ]
        exact = reference(p, balanced_state(p, x=manoeuvre.x), moves)[1:, 0]
        found = positions(manoeuvre, Solver.RUNGE_KUTTA, FINE)
        worst = max(worst, 1e6 * float(np.abs(found - exact).max()))
    return worst


class Worker:
    """A process that runs manoeuvres with the plant of one source tree."""

    def __init__(self, tree: Path, seed: int) -> None:
        """Start it on the package in `tree`."""
        # Another tree has a cache of its own: Numba's knows a kernel's file, not those of the
        # kernels within.
        self._cache = tempfile.TemporaryDirectory()
        environment = os.environ | {"PYTHONPATH": str(tree)}
        if tree != ROOT:
            environment["NUMBA_CACHE_DIR"] = self._cache.name
        program = Path(__file__).with_name("manoeuvres.py")
        command = [sys.executable, str(program), str(seed), str(DEFAULT_STEP)]
        self._process = subprocess.Popen(  # noqa: S603 - our own program
            command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def run(self, number: int) -> Run:
        """Run a manoeuvre in the process, as `run` does.

        Raises:
            RuntimeError: the process has no pipes.
        """
        requests, answers = self._process.stdin, self._process.stdout
        if requests is None or answers is None:
            raise RuntimeError("the process has no pipes")
        requests.write(f"{number}\n")
        requests.flush()
        x, evaluations, most, cost = json.loads(answers.readline())
        return Run(np.array(x), evaluations, most, cost)

    def close(self) -> None:
        """End the process."""
        self._process.communicate()
        self._cache.cleanup()


@dataclass(frozen=True)
class Result:
    """The results of one plant in all manoeuvres: errors [um], and the fields of `Run`."""

    errors: Array
    evaluations: Array
    most: Array
    costs: Array


def extract(revision: str, into: Path) -> Path:
    """Unpack the package of an older revision; return the tree."""
    command = ["git", "archive", revision, "hil_bench"]
    archive = subprocess.run(command, cwd=ROOT, check=True, capture_output=True)  # noqa: S603
    with tarfile.open(fileobj=io.BytesIO(archive.stdout)) as tree:
        tree.extractall(into, filter="data")
    if (into / "hil_bench" / "plant").exists():  # a revision before the models moved
        models = into / "hil_bench" / "plants" / "hydraulic_cylinder"
        models.mkdir(parents=True)
        (models / "model.py").write_text("from hil_bench.plant import *\n", encoding="ascii")
    return into


def compare(
    trees: dict[str, Path], seed: int, count: int
) -> tuple[dict[str, Result], Array, list[str]]:
    """Run all manoeuvres on each tree in turn and on the reference.

    Args:
        trees: by the name of what they hold.
        seed: of the manoeuvres.
        count: of the manoeuvres.

    Returns:
        The results, how far the two references are apart [um], and the kinds.
    """
    workers = {name: Worker(tree, seed) for name, tree in trees.items()}
    rows: dict[str, list[tuple[float, ...]]] = {name: [] for name in trees}
    apart, kinds = [], []
    for number in range(count):
        manoeuvre = draw(seed, number)
        exact = positions(manoeuvre, Solver.RUNGE_KUTTA, FINE)
        coarse = positions(manoeuvre, Solver.RUNGE_KUTTA, COARSE)
        apart.append(1e6 * float(np.abs(exact - coarse).max()))
        kinds.append(manoeuvre.kind)
        for name, worker in workers.items():
            found = worker.run(number)
            rows[name].append((1e6 * float(np.abs(found.x - exact).max()), *found[1:]))
    for worker in workers.values():
        worker.close()
    results = {name: Result(*np.array(found).T) for name, found in rows.items()}
    return results, np.array(apart), kinds


def distribution(errors: Array) -> str:
    """Return the cells of a distribution of errors [um]."""
    quantiles = " | ".join(f"{value:.3g}" for value in np.quantile(errors, (0.5, 0.9, 0.99, 1.0)))
    return f"{quantiles} | {np.count_nonzero(errors < 1.0)} of {len(errors)}"


def print_results(results: dict[str, Result], apart: Array, kinds: list[str]) -> None:
    """Print the tables."""
    print("\n| position error [um] | median | 90 % | 99 % | worst | below 1 um |")
    print("|---|---|---|---|---|---|")
    for name, result in results.items():
        print(f"| {name} | {distribution(result.errors)} |")
    print(f"| Runge-Kutta, 2 us for 1 us | {distribution(apart)} |")

    print("\n| cost | evaluations a step, mean | of the worst run | most in a tick | us a tick |")
    print("|---|---|---|---|---|")
    for name, result in results.items():
        mean, worst, most = result.evaluations.mean(), result.evaluations.max(), result.most.max()
        cost = np.median(result.costs)
        print(f"| {name} | {mean:.3f} | {worst:.3f} | {most:g} | {cost:.2f} |")

    head = " | ".join(f"{name}: median | worst | evaluations" for name in results)
    print(f"\n| kind | {head} |")
    print("|---" * (1 + 3 * len(results)) + "|")
    for kind in dict.fromkeys(kinds):
        which = np.array(kinds) == kind
        cells = []
        for result in results.values():
            errors, evaluations = result.errors[which], result.evaluations[which].mean()
            cells.append(f"{np.median(errors):.3g} | {errors.max():.3g} | {evaluations:.2f}")
        print(f"| {kind} | {' | '.join(cells)} |")


def draw_distribution(results: dict[str, Result], path: Path) -> None:
    """Draw the share of runs whose error stays below a bound, over the bound."""
    import matplotlib as mpl  # noqa: PLC0415 - for the picture only
    from matplotlib.figure import Figure  # noqa: PLC0415

    with mpl.rc_context(figure_style.STYLE):
        figure = Figure(figsize=(6.4, 3.2), layout="constrained")
        axes = figure.subplots()
        axes.set(xscale="log", xlabel="largest position error of a run [um]", ylabel="runs [%]")
        colours = (
            (figure_style.RED, figure_style.BLUE) if len(results) > 1 else (figure_style.BLUE,)
        )
        for (name, result), colour in zip(results.items(), colours, strict=True):
            errors = np.sort(result.errors)
            share = 100.0 * np.arange(1, len(errors) + 1) / len(errors)
            axes.step(errors, share, where="post", color=colour, label=name)
        axes.axvline(1.0, color=figure_style.GREY, linestyle=":")
        axes.legend(loc="lower right")
        figure.savefig(path, dpi=150)


def main() -> None:
    """Draw, run, compare and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=200, help="manoeuvres")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--before", metavar="REVISION", help="run this one, too, in turns")
    parser.add_argument("--plot", type=Path, metavar="PNG", help="draw the distribution")
    arguments = occasion.arguments(parser, count=10)
    with tempfile.TemporaryDirectory() as folder:
        trees = {}
        if arguments.before:
            trees[arguments.before] = extract(arguments.before, Path(folder))
        trees["this tree"] = ROOT
        results, apart, kinds = compare(trees, arguments.seed, arguments.count)
    print_results(results, apart, kinds)
    if arguments.plot:
        draw_distribution(results, arguments.plot)
    apart = check_reference(arguments.seed)
    print(
        f"\nRunge-Kutta at 1 us and LSODA are at most {apart:.4f} um apart ({CHECKED} manoeuvres)."
    )


if __name__ == "__main__":
    main()
