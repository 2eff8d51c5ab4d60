"""Two recordings of a strange machine: is what has changed between them named, and else nothing?

Run: `python benchmarks/identification_changes.py [--defects 20] [--healthy 40] [--scale 1]
[--seed SEED] [--folder DIR]`.

Each pair is of a machine of `tests/support/strange_changes.py`, one file before and one after with
two strokes each way at three amplitudes. In healthy pairs oil temperature, supply, friction and
the sensors' offsets differ as from day to day; in the others one defect is drawn beside that, of
the size in that file times 1 to 1.5 and `--scale`. `hil-bench identify AFTER bench.toml --against
BEFORE` gets the owner's data sheet. A defect is named rightly where its unknown is the first that
the verb names. Results are kept in the folder, and what is there is not done again. Prints
Markdown.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import occasion

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.strange_changes import DEFECTS, Pair, draw_pair
from support.strange_logger import write_record
from support.strange_machines import write_sheet

SEED = 30
STROKES = 2  # each way at each amplitude
NAMES: Final[Mapping[str, tuple[str, ...]]] = {
    "leakage across the piston": ("internal_leakage_l_min_bar",),
    "worn edge": ("null_opening_um", "land_overlap_pa_mm"),
    "trapped air": ("entrained_air_percent",),
    "friction up": ("coulomb_friction_n", "viscous_friction_n_s_m"),
    "supply down": ("supply_pressure_bar", "relief_pressure_bar"),
    "sensor offset": ("offset_a", "offset_b"),
}
"""The unknowns of which one is the right answer."""


def ask(pair: Pair, folder: Path, seed: int, *, is_brief: bool) -> dict[str, Any]:
    """Write both recordings of a pair and return what the verb says of them."""
    strokes = 1 if is_brief else STROKES
    before, after = (
        write_record(stranger, logger, folder / name, seed, strokes, take)
        for take, (name, (stranger, logger)) in enumerate(
            {"before": pair.before, "after": pair.after}.items(), start=3
        )
    )
    sheet = folder / "bench.toml"
    sheet.write_text(write_sheet(pair.before[0].sheet), encoding="utf-8")
    command = [sys.executable, "-m", "hil_bench", "identify", str(after), str(sheet)]
    command += ["--columns", str(after.parent / "rig.toml"), "--against", str(before), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - ours
    if done.returncode not in {0, 1, 6}:
        occasion.missing("identify --against", done.stderr.strip())
    return dict(json.loads(done.stdout))


def judge(pair: Pair, said: dict[str, Any]) -> dict[str, Any]:
    """Return a pair beside what was said of it."""
    names = [one["name"].partition(":")[0] for one in said["changes"]]
    right = NAMES[pair.defect.name] if pair.defect else ()
    return {
        "machine": pair.before[0].number,
        "defect": pair.defect.name if pair.defect else "",
        "size": f"{pair.size:.3g} {pair.defect.unit}" if pair.defect else "",
        "is_alarm": said["is_changed"] is True,
        "is_open": said["is_changed"] is None,
        "times_worse": said["times_worse"],
        "named": [one["words"] for one in said["changes"]],
        "is_right": bool(names and names[0] in right) if right else said["is_changed"] is False,
    }


def run(args: argparse.Namespace, folder: Path) -> None:
    """Ask about all pairs, and print."""
    numbers = [(number, None) for number in range(args.healthy)]
    numbers += [(number, DEFECTS[number % len(DEFECTS)]) for number in range(args.defects)]
    results = []
    for number, defect in numbers:
        path = folder / f"{'healthy' if defect is None else 'defect'}-{number:02}.json"
        if not path.exists():
            pair = draw_pair(args.seed, number, defect, args.scale)
            said = ask(pair, folder / path.stem, args.seed, is_brief=args.brief)
            path.write_text(json.dumps(judge(pair, said)), encoding="utf-8")
            print(path.stem, file=sys.stderr, flush=True)
        results.append(json.loads(path.read_text(encoding="utf-8")))
    print("| machine | defect | size | fits worse | named | right |")
    print("|---|---|---|---|---|---|")
    for one in results:
        unnamed = "undecided" if one["is_open"] else "unexplained" if one["is_alarm"] else "nothing"
        named = ", ".join(one["named"]) or unnamed
        cells = (one["defect"] or "none", one["size"], f"{one['times_worse']:.2f} times", named)
        verdict = "yes" if one["is_right"] else "no"
        print(f"| {one['machine']} | {' | '.join(cells)} | {verdict} |")
    healthy = [one for one in results if not one["defect"]]
    defects = [one for one in results if one["defect"]]
    print(f"\nalarms on healthy pairs: {sum(one['is_alarm'] for one in healthy)} of {len(healthy)}")
    print(f"undecided of healthy pairs: {sum(one['is_open'] for one in healthy)} of {len(healthy)}")
    print(f"defects noticed: {sum(one['is_alarm'] for one in defects)} of {len(defects)}")
    print(f"undecided of defects: {sum(one['is_open'] for one in defects)} of {len(defects)}")
    print(f"named rightly: {sum(one['is_right'] for one in defects)} of {len(defects)}")


def main() -> None:
    """Draw, ask and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--defects", type=int, default=20)
    parser.add_argument("--healthy", type=int, default=40)
    parser.add_argument("--scale", type=float, default=1.0, help="of the defects' sizes")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--folder", type=Path, help="for recordings and results")
    args = occasion.arguments(parser, defects=0, healthy=1)
    if args.folder:
        args.folder.mkdir(parents=True, exist_ok=True)
        run(args, args.folder)
    else:
        with tempfile.TemporaryDirectory() as name:
            run(args, Path(name))


if __name__ == "__main__":
    main()
