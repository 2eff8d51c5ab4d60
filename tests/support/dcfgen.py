"""dcfgen of Lely CANopen, which configures masters by CiA 302 (PyPI: dcf-tools)."""

import shutil
import subprocess
import sys
from pathlib import Path

PROGRAM = "import sys; sys.path.insert(0, '.'); from dcfgen.cli import main; main()"
PKG_RESOURCES = """
import importlib.util, pathlib
def resource_filename(module, name):
    return str(pathlib.Path(importlib.util.find_spec(module).origin).parent / name)
"""
"""What dcfgen wants of setuptools, which has dropped it: the place of its own template."""


def run_dcfgen(folder: Path, settings: str, **eds: Path) -> Path:
    """Runs it on settings and EDS files by name, and returns the folder of what it has written."""
    for name, path in eds.items():
        shutil.copy(path, folder / f"{name}.eds")
    (folder / "network.yml").write_text(settings, encoding="utf-8")
    (folder / "pkg_resources.py").write_text(PKG_RESOURCES, encoding="utf-8")
    done = subprocess.run(  # noqa: S603 - a tool of the environment
        [sys.executable, "-c", PROGRAM, "network.yml"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder
