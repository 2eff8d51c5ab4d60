"""Builds the wheels with a compiled core, one for each Python that is here, and the pure one.

    python .ci/build_wheels.py [--output DIRECTORY] [--only 3.12 ...]

It looks for python3.11 to python3.14 on the PATH and says what came of each. Each wheel is for
this system and processor. It needs a C compiler and a package index. Exit code 1: one that was
begun is not compiled.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
VERSIONS = ("3.11", "3.12", "3.13", "3.14")
TOOLS = "build>=1.2,<2"


def find_python(version: str) -> str | None:
    """Return a program of that version that runs, None where there is none."""
    program = shutil.which(f"python{version}")
    if program is None:
        return None
    done = subprocess.run([program, "-c", "import venv"], capture_output=True, check=False)  # noqa: S603 - just found
    return None if done.returncode else program


def build(program: str, output: Path, *, is_compiled: bool) -> str:
    """Build a wheel with that Python; return its name."""
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        python = place / "venv" / "bin" / "python"
        environment = os.environ | {"HIL_BENCH_COMPILE": str(int(is_compiled))}
        for command in (
            [program, "-m", "venv", place / "venv"],
            [python, "-m", "pip", "install", "-q", TOOLS],
            [python, "-m", "build", "--wheel", "--outdir", place / "dist", ROOT],
        ):
            done = subprocess.run(  # noqa: S603 - commands of our own
                command, env=environment, capture_output=True, text=True, check=False
            )
            if done.returncode:
                sys.exit(f"{done.stdout}\n{done.stderr}")
        (wheel,) = (place / "dist").iterdir()
        output.mkdir(parents=True, exist_ok=True)
        shutil.copy(wheel, output)
        return wheel.name


def main() -> None:
    """Build, and print a line for each wheel."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=ROOT / "dist")
    parser.add_argument("--only", nargs="+", default=VERSIONS, metavar="VERSION")
    args = parser.parse_args()
    failed = False
    print(f"any Python: {build(sys.executable, args.output, is_compiled=False)}", flush=True)
    for version in args.only:
        program = find_python(version)
        if program is None:
            print(f"Python {version}: not built, there is no python{version} here", flush=True)
            continue
        name = build(program, args.output, is_compiled=True)
        is_pure = name.endswith("-none-any.whl")
        failed |= is_pure
        print(f"Python {version}: {'not compiled' if is_pure else name}", flush=True)
    sys.exit(failed)


if __name__ == "__main__":
    main()
