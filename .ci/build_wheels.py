"""Builds the wheels with a compiled core, one for each Python that is here, and the pure one.

    python .ci/build_wheels.py [--output DIRECTORY] [--only 3.12 ...]

It looks for python3.11 to python3.14 on the PATH and says what came of each. Each wheel is for
this system and processor. It needs a C compiler and a package index. Exit code 1: one that was
begun is not compiled, or lacks a part.
"""

import argparse
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
VERSIONS = ("3.11", "3.12", "3.13", "3.14")
IS_X86_64 = platform.machine() == "x86_64"
"""Where a wheel carries the plant's kernels, too."""
TOOLS = "build>=1.2,<2"


def find_python(version: str) -> str | None:
    """Return a program of that version that runs, None where there is none."""
    program = shutil.which(f"python{version}")
    if program is None:
        return None
    done = subprocess.run([program, "-c", "import venv"], capture_output=True, check=False)  # noqa: S603 - just found
    return None if done.returncode else program


def build(program: str, output: Path, *, is_compiled: bool) -> Path:
    """Build a wheel with that Python; return it."""
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
        return Path(shutil.copy(wheel, output))


def what_is_missing(wheel: Path) -> str:
    """Return the parts of a compiled wheel that this one lacks; empty for nothing."""
    if wheel.name.endswith("-none-any.whl"):
        return "not compiled"
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    if "hil_bench/compiled.json" not in names:
        return f"{wheel.name}, without the core"
    has_kernels = any("/_kernels." in name and name.endswith(".so") for name in names)
    return "" if has_kernels or not IS_X86_64 else f"{wheel.name}, without the plant's kernels"


def main() -> None:
    """Build, and print a line for each wheel."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=ROOT / "dist")
    parser.add_argument("--only", nargs="+", default=VERSIONS, metavar="VERSION")
    args = parser.parse_args()
    failed = False
    print(f"any Python: {build(sys.executable, args.output, is_compiled=False).name}", flush=True)
    for version in args.only:
        program = find_python(version)
        if program is None:
            print(f"Python {version}: not built, there is no python{version} here", flush=True)
            continue
        wheel = build(program, args.output, is_compiled=True)
        missing = what_is_missing(wheel)
        failed |= bool(missing)
        print(f"Python {version}: {missing or wheel.name}", flush=True)
    sys.exit(failed)


if __name__ == "__main__":
    main()
