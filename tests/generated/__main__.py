"""Generated files for every verb that reads one: ``python tests/generated [--cases N]``.

Each file begins as a sound one and is edited step by step, with a verb after each edit; see
`edits.py`. Exit code 1: a verb ended with 70, raised, hung, printed what is not printable, refused
a file without naming it, or left a file behind.
"""

import argparse
import functools
import importlib.metadata
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from generated.dialects import COSTLY, DIALECTS, SLOWER, Dialect
from generated.hostile import binary_dialects
from generated.play import Tally, live, run_verb
from generated.seeds import install_plugin, lay_out
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from hypothesis.errors import Flaky

_BRIEF = 1000  # files: about half a minute
_QUICK = 6  # times as many files for a quick verb
_AT_ONCE = 20  # lives of which hypothesis keeps a record


def main() -> int:
    """Run the cases, and print the table."""
    verbs = sorted({words[0] for form in DIALECTS for words in form.verbs})
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=1000, help="files of each run (1000)")
    parser.add_argument("--brief", action="store_true", help=f"{_BRIEF} files of all cheap verbs")
    parser.add_argument("--seed", type=int, default=1, help="(1)")
    parser.add_argument("--verb", choices=verbs, help="this verb alone (default: all cheap ones)")
    parser.add_argument("--binary", action="store_true", help="binary files in place of texts")
    parser.add_argument("--found", type=Path, help="folder for the files that broke a verb")
    arguments = parser.parse_args()
    cases = _BRIEF if arguments.brief else arguments.cases
    # The installed distributions stay what they are; to look at them takes 10 ms a file.
    importlib.metadata.entry_points = functools.cache(importlib.metadata.entry_points)
    chosen = [verb for verb in verbs if arguments.binary or verb not in COSTLY]
    chosen = [arguments.verb] if arguments.verb else chosen
    tally = Tally(arguments.found)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        (root / "scratch").mkdir()
        tempfile.tempdir = str(root / "scratch")
        lay_out(root)
        install_plugin(root)
        os.chdir(root / "examples")
        run_verb("", ("export-fmu", "axis.fmu"))
        dialects = binary_dialects(root / "examples") if arguments.binary else DIALECTS
        fill(tally, root, chosen, dialects, cases=cases, first=arguments.seed)
        os.chdir(HERE)
    print(*tally.lines(), sep="\n")
    return 1 if tally.wrong else 0


def fill(
    tally: Tally,
    root: Path,
    verbs: list[str],
    dialects: Sequence[Dialect],
    *,
    cases: int,
    first: int,
) -> None:
    """Play lives of files until there are enough."""
    pairs = [
        (verb, form)
        for verb in verbs
        for form in dialects
        if any(words[0] == verb for words in form.verbs)
        for _ in range(1 if verb in SLOWER else _QUICK)
    ]

    @settings(
        max_examples=_AT_ONCE,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.data())
    def play(source: st.DataObject) -> None:
        verb, form = source.draw(st.sampled_from(pairs))
        for result, text in live(source.draw, root, form, verb):
            tally.add(result, text)

    number = first * 1_000_000
    while tally.files < cases:
        number += 1
        try:
            seed(number)(play)()
        except Flaky as error:  # a verb took longer than before, and so was ended
            print(f"lives of {number} were cut short: {error}")


if __name__ == "__main__":
    sys.exit(main())
