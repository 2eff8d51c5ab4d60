"""The product's verdicts against the referee of the tests, a second evaluator of requirements.

    python benchmarks/referee.py [--cases N] [--plays N] [--seed N] [--brief]

1. Each case, a requirement with a run in memory: `judge`, and a monitor that takes it in blocks.
2. Each fifth case: the same as a file of requirements and a recording with gaps, late starts and
   rows beside their ticks, shorter or longer than planned; each fiftieth by the verb `judge`.
3. Each play: 25 requirements on a run of the bench, as `test` judges it; each fifth by the verb
   itself, with its exit code, and as a campaign of 8 runs.

It prints the cases by outcome and by what they hold, and each disagreement. "Decided by rounding"
are those in which two sides of a comparison are the same number in decimals and not in doubles.
Exit code 1: the referee disagrees with something else. Ctrl-C ends it early.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import occasion

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from referee.agreement import (
    ROUNDED,
    differences_in_memory,
    differences_of_file,
    differences_of_verb,
)
from referee.asking import conditions_in, refusals
from referee.cases import Case, draw
from referee.evaluator import Run
from referee.played import Played

EACH = 5
REQUIREMENTS = 25
RUNS = 8


class Count:
    """Counts of the cases, and of those in which the referee disagreed."""

    def __init__(self) -> None:
        self.cases: Counter[str] = Counter()
        self.rounded: Counter[str] = Counter()
        self.wrong: Counter[str] = Counter()
        self.outcomes: Counter[str] = Counter()
        self.forms: Counter[str] = Counter()

    def take(self, path: str, name: str, found: Iterable[str], cases: int = 1) -> None:
        """Take what the referee says of some cases, and print what it contradicts."""
        differences = list(found)
        wrong = [each for each in differences if not each.startswith(ROUNDED)]
        self.cases[path] += cases
        self.rounded[path] += bool(differences) and not wrong
        self.wrong[path] += bool(wrong)
        for each in wrong:
            print(f"{path} {name}: {each}")

    def print(self) -> None:
        """Print the tables."""
        for title, found in (("outcome", self.outcomes), ("form", self.forms)):
            print(f"| {title} | cases |", "|---|---|", sep="\n")
            for name, times in found.most_common():
                print(f"| {name} | {times} |")
        print(
            "| path | cases | decided by rounding | disagreements |", "|---|---|---|---|", sep="\n"
        )
        for path, cases in self.cases.items():
            print(f"| {path} | {cases} | {self.rounded[path]} | {self.wrong[path]} |")


def words_of(case: Case) -> set[str]:
    """Return the forms that a requirement has."""
    return {getattr(tree, "name", type(tree).__name__.lower()) for tree in conditions_in(case.tree)}


def judge_cases(count: Count, cases: int, seed: int, folder: Path) -> None:
    """Judge cases in memory, and some in files."""
    for number in range(cases):
        case = draw(seed, number)
        count.take("judge, monitor", f"{number}", differences_in_memory(case))
        if number % EACH == 0:
            count.take("judge of files", f"{number}", differences_of_file(case, folder))
        if number % (10 * EACH) == 0:
            count.take("verb judge", f"{number}", differences_of_verb(case, folder))
        count.forms.update(words_of(case))
        if refusals(case.tree, case.tick, None):
            count.outcomes["refused"] += 1
        else:
            run = Run(case.values(), case.ticks, case.tick)
            count.outcomes[run.rule(case.tree).outcome] += 1


def judge_plays(count: Count, plays: int, seed: int, folder: Path) -> None:
    """Judge runs of the bench and of campaigns."""
    for number in range(plays):
        name = f"{seed} {number}"
        played = Played(name, folder, REQUIREMENTS)
        count.take("test", name, played.differences_in_test(), REQUIREMENTS)
        if number % EACH == 0:
            count.take("verb test", name, played.differences_in_verb(), REQUIREMENTS)
            found = played.differences_in_campaign(folder / f"{number}.results", RUNS)
            count.take("campaign", name, found, REQUIREMENTS * RUNS)


def main() -> int:
    """Print the tables; return 1 where the referee disagrees."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--plays", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    options = occasion.arguments(parser, cases=200, plays=1)
    count = Count()
    print(f"seed {options.seed}")
    with TemporaryDirectory() as folder, suppress(KeyboardInterrupt):
        judge_plays(count, options.plays, options.seed, Path(folder))
        judge_cases(count, options.cases, options.seed, Path(folder))
    count.print()
    return 1 if count.wrong.total() else 0


if __name__ == "__main__":
    sys.exit(main())
