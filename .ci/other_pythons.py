"""Run README's tests on each other Python of the classifiers: ``other_pythons.py WORK``.

WORK is a folder for a copy of the sources and an environment each, in folders with a blank in their
names. A version that this machine does not have is named. The first that has ``sys.monitoring``
measures meanwhile which lines run, for a tenth of the time: tracers of older ones double it, as do
branches before Python 3.14. Those after it leave out the slow tests of what only computes, and draw
fewer examples (docs/decisions/0338-what-the-third-python-need-not-repeat.md). Exit code 1: the
tests failed on one that the machine has, or left too many lines alone.
"""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PYENV = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
"""Where pyenv keeps its Pythons: those on the PATH run only where they are chosen."""
MONITORED = (3, 12)
"""The first version with ``sys.monitoring``."""
COMPUTES = (
    "tests/referee/",
    "tests/unit/analysis/",
    "tests/unit/commissioning/",
    "tests/unit/conformance/",
    "tests/unit/drive/",
    "tests/unit/identification/",
    "tests/unit/measurement/",
    "tests/unit/plant/",
    "tests/unit/shadow/",
)
"""Where slow tests play machines in virtual time and reckon: no other process, no server."""


def classified_versions() -> list[str]:
    """Return the minor versions of Python that the classifiers name."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    found = (re.fullmatch(r".* :: (3\.\d+)", each) for each in project["classifiers"])
    return [match[1] for match in found if match]


def candidates(version: str) -> Iterator[Path]:
    """Yield the programs that may be a Python of this version."""
    program = shutil.which(f"python{version}")
    if program is not None:
        yield Path(program)
    yield from sorted(PYENV.glob(f"{version}.*/bin/python{version}"))


def find_python(version: str) -> Path | None:
    """Return a Python of this version that runs and makes environments; None for none."""
    for program in candidates(version):
        command = [program, "-c", "import ensurepip, venv"]
        if not subprocess.run(command, capture_output=True, check=False).returncode:  # noqa: S603 - just found
            return program
    return None


def left_out() -> list[str]:
    """Return the tests that Pythons after the measured one need not repeat."""
    names = (ROOT / "tests" / "slow_tests.txt").read_text(encoding="utf-8").split()
    return [name for name in names if name.startswith(COMPUTES)]


def test_on(program: Path, place: Path, options: list[str], *, measured: bool) -> int:
    """Run README's tests in a fresh copy with a fresh environment; return their exit code.

    What the environment needs is there when README's command asks pip for it; pytest-cov, too,
    where coverage is measured. `options` are those of pytest besides README's.
    """
    place.mkdir(parents=True)
    command = "git ls-files -z --cached --others --exclude-standard | tar --null -T - -cf - "
    copy = f'{command} | tar -xf - -C "{place}"'
    subprocess.run(["bash", "-euo", "pipefail", "-c", copy], cwd=ROOT, check=True)  # noqa: S603, S607
    (place / "bin").mkdir()
    (place / "bin" / "python3").symlink_to(program)  # README says `python3`
    block = [sys.executable, ROOT / ".ci" / "readme_block.py", ROOT / "README.md", "test-command"]
    script = subprocess.run(block, capture_output=True, text=True, check=True).stdout  # noqa: S603 - ours
    environment = os.environ | {"PATH": f"{place / 'bin'}{os.pathsep}{os.environ['PATH']}"}
    subprocess.run([program, "-m", "venv", place / ".venv"], check=True)  # noqa: S603 - found above
    wanted = ["-e", f"{place}[test]", *(["pytest-cov>=6,<8"] if measured else [])]
    install = [
        sys.executable,
        ROOT / ".ci" / "quick_install.py",
        place / ".venv" / "bin" / "python",
    ]
    subprocess.run([*install, *wanted], check=True)  # noqa: S603 - ours
    environment |= {"COVERAGE_CORE": "sysmon", "PYTEST_ADDOPTS": " ".join(options)}
    run = ["bash", "-euo", "pipefail", "-c", script]
    return subprocess.run(run, cwd=place, env=environment, check=False).returncode  # noqa: S603 - README's


def main() -> int:
    """Print a line for each version; return 1 where its tests failed."""
    here = f"{sys.version_info.major}.{sys.version_info.minor}"
    verdicts = {here: "README's tests run in a section of their own"}
    measured_on = ""
    for version in classified_versions():
        if version == here:
            continue
        program = find_python(version)
        if program is None:
            verdicts[version] = "NOT TRIED: this machine does not have it"
            continue
        print(f"== Python {version}", flush=True)
        measured = not measured_on and tuple(map(int, version.split("."))) >= MONITORED
        options, scope = ["--cov", "--cov-report=term"] if measured else [], "all of them"
        if measured_on:
            options = ["--hypothesis-profile=brief", *(f"--deselect={each}" for each in left_out())]
            scope = f"without {len(left_out())} slow test functions of what only computes"
        measured_on = version if measured else measured_on
        place = Path(sys.argv[1]) / f"Python {version}"
        code = test_on(program, place, options, measured=measured)
        verdicts[version] = f"FAILED: exit code {code}" if code else f"passed, {scope}"
    for version in sorted(verdicts):
        print(f"Python {version}: {verdicts[version]}")
    if not measured_on:
        print("coverage: NOT MEASURED: no other Python of this machine has sys.monitoring")
    return int(any(verdict.startswith("FAILED") for verdict in verdicts.values()))


if __name__ == "__main__":
    sys.exit(main())
