"""The house in figures: rooms, layers, modules and lines, and who imports whom.

    python benchmarks/house.py [--against CHECKOUT]

Lines are those of Python that have code: no blank line, comment or docstring. The core is
`hil_bench` without `abilities` and `plants`. Beside another checkout, both.
"""

import argparse
import ast
import re
import tomllib
from pathlib import Path

import occasion

ROOT = Path(__file__).parents[1]


def count_lines(path: Path) -> int:
    """Return the lines of a file that have code."""
    text = path.read_text(encoding="utf-8")
    shown = enumerate(map(str.strip, text.splitlines()), start=1)
    lines = {number for number, line in shown if line and not line.startswith("#")}
    docstrings = set[int]()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Constant | ast.JoinedStr) and node.end_lineno != node.lineno:
            lines |= {*range(node.lineno, node.end_lineno + 1)}  # blank lines of a text, too
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            value = node.value
            if isinstance(value.value, str):
                docstrings |= {*range(value.lineno, value.end_lineno + 1)}
    lines -= docstrings
    return len(lines)


def figures(root: Path) -> dict[str, int]:
    """Return the figures of a checkout, by what they count."""
    house = root / "hil_bench"
    sizes = {path.relative_to(house): count_lines(path) for path in house.rglob("*.py")}
    core = [path for path in sizes if path.parts[0] != "abilities"]
    named = re.compile(r"hil_bench\.abilities\.\w")
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = project["tool"]["importlinter"]["contracts"]
    layers = next(each["layers"] for each in contracts if each["type"] == "layers")
    inside = {path.parts[0] for path in sizes if len(path.parts) > 1}
    return {
        "rooms at the top, but for `abilities`": len(inside - {"abilities"}),
        "layers": len(layers),
        "abilities": len(
            {path.parts[1] for path in sizes if path not in core} - {"__init__.py", "common"}
        ),
        "modules": len(sizes),
        "modules of less than 30 lines": sum(0 < size < 30 for size in sizes.values()),
        "modules of `cli`": sum(path.parts[0] == "cli" for path in sizes),
        "lines of `cli`": sum(size for path, size in sizes.items() if path.parts[0] == "cli"),
        "lines of the core": sum(sizes[path] for path in core if path.parts[0] != "plants"),
        "imports from the core to abilities": sum(
            len(named.findall((house / path).read_text(encoding="utf-8"))) for path in core
        ),
        "lines of `hil_bench`": sum(sizes.values()),
        "lines of `tests`": sum(map(count_lines, (root / "tests").rglob("*.py"))),
    }


def main() -> None:
    """Print the figures as a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--against", type=Path)
    args = occasion.arguments(parser)
    here = figures(ROOT)
    there = figures(args.against) if args.against else {}
    print(f"\n| |{' before |' if there else ''} here |\n|---|{'---|' if there else ''}---|")
    for what, count in here.items():
        before = f" {there[what]} |" if there else ""
        print(f"| {what} |{before} {count} |")


if __name__ == "__main__":
    main()
