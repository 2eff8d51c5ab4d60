"""Generated files for every verb that reads one: ``python tests/generated [--cases N]``.

Each file begins as a sound one and is edited step by step, with a verb after each edit; see
`edits.py`. Exit code 1: a verb ended with 70, raised, printed what is not printable, or hung.
"""

import argparse
import contextlib
import sys
import tempfile
from pathlib import Path
from random import Random

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from generated.play import Tally, live
from generated.seeds import DIALECTS, lay_out
from hypothesis import strategies as st
from hypothesis.errors import StopTest
from hypothesis.internal.conjecture.data import ConjectureData


def main() -> int:
    """Run the cases, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=1000, help="files in all (1000)")
    parser.add_argument("--seed", type=int, default=1, help="(1)")
    parser.add_argument("--verb", default="", help="this verb alone")
    parser.add_argument("--found", type=Path, help="folder for the files that broke a verb")
    arguments = parser.parse_args()
    dialects = [
        name
        for name, form in DIALECTS.items()
        if not arguments.verb or any(words[0] == arguments.verb for words in form.verbs)
    ]
    if not dialects:
        known = sorted({words[0] for form in DIALECTS.values() for words in form.verbs})
        parser.error(f"--verb {arguments.verb}: give one of {', '.join(known)}")
    tally = Tally()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        (root / "scratch").mkdir()
        tempfile.tempdir = str(root / "scratch")
        lay_out(root)
        fill(tally, root, dialects, arguments)
    print(*tally.lines(), sep="\n")
    for result in tally.slow:
        print(f"slow: {result.took:.1f} s {' '.join(result.words)} ({result.dialect})")
    for number, (result, text) in enumerate(tally.wrong):
        print(f"WRONG {number}: {' '.join(result.words)} ({result.dialect}): {result.wrong}")
        if arguments.found:
            arguments.found.mkdir(parents=True, exist_ok=True)
            name = f"{number}-{result.dialect}-{'-'.join(result.words[:2])}.txt"
            (arguments.found / name).write_text(text, encoding="utf-8")
    return 1 if tally.wrong else 0


def fill(tally: Tally, root: Path, dialects: list[str], arguments: argparse.Namespace) -> None:
    """Play lives of files until there are enough; each is drawn from a seed of its own."""
    life = 0
    while tally.files < arguments.cases:
        life += 1
        source = ConjectureData(random=Random(f"{arguments.seed} {life}"))
        with contextlib.suppress(StopTest):  # it has drawn more than an example may
            dialect = source.draw(st.sampled_from(dialects))
            for result, text in live(source.draw, root, dialect, arguments.verb):
                tally.add(result, text)


if __name__ == "__main__":
    sys.exit(main())
