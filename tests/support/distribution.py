"""Other distributions, installed into a folder of their own for a test."""

import importlib.util
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path

PLUGIN = Path(__file__).parents[2] / "examples" / "plugin"


def pip_install(source: Path, target: Path) -> None:
    """Install a package by pip, without network; where pip is not at hand, as pip would do it."""
    if importlib.util.find_spec("pip") and importlib.util.find_spec("hatchling"):
        command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
        options = ["--no-build-isolation", "--disable-pip-version-check", "--target", str(target)]
        copy = target.with_name(f"{target.name}-source")
        shutil.copytree(source, copy)  # the build leaves nothing in the sources
        subprocess.run([*command, *options, str(copy)], check=True)  # noqa: S603 - our own pip
        return
    project = tomllib.loads((source / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    package = source / project["name"].replace("-", "_")
    shutil.copytree(package, target / package.name)
    declare(target, project["name"], project["version"], project["entry-points"])


def declare(target: Path, name: str, version: str, groups: Mapping[str, Mapping[str, str]]) -> None:
    """Write what an installed distribution says of itself."""
    folder = target / f"{name.replace('-', '_')}-{version}.dist-info"
    folder.mkdir(parents=True)
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    lines = []
    for group, points in groups.items():
        lines += [f"[{group}]", *(f"{point} = {value}" for point, value in points.items())]
    (folder / "entry_points.txt").write_text("\n".join(lines))
