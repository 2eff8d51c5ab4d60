"""Compiles the core of the bench with mypyc into the wheel, where that is asked for.

    HIL_BENCH_COMPILE=1 pip install .

Without that variable, in an editable installation, and where there is no C compiler, the wheel is
pure Python and does the same, slower. `pyproject.toml` names the modules. The wheel says in
`hil_bench/compiled.json` of which sources its machine code was made.
"""

import hashlib
import importlib.metadata
import json
import os
import shutil
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

GROUP = "hil_bench_core"
RECORD = "hil_bench/compiled.json"
REQUIREMENTS = ["mypy>=2.4,<3", "setuptools>=70"]


class CompiledCore(BuildHookInterface):  # type: ignore[type-arg]
    """Adds the compiled modules to a wheel."""

    def dependencies(self) -> list[str]:
        """Return what a compiling build needs, nothing for any other."""
        return REQUIREMENTS if is_asked_for() else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and have the wheel carry it; a wheel without it where that fails."""
        if version == "editable" or not is_asked_for():
            return
        self._directory = tempfile.mkdtemp()
        root, built = Path(self.root), Path(self._directory)
        sources = matches(root, self.config["modules"]) - matches(root, self.config["uncompiled"])
        names = sorted(path.relative_to(root).as_posix() for path in sources)
        try:
            compile_modules(root, names, built)
        except Problem as problem:
            self.app.display_warning(f"the core is not compiled: {problem}; it runs as Python")
            return
        record = built / "compiled.json"
        record.write_text(json.dumps(record_of(root, names), indent=1) + "\n", encoding="utf-8")
        included = {
            str(path): path.relative_to(built / "lib") for path in built.rglob("lib/**/*.so")
        }
        build_data["force_include"] |= {path: str(place) for path, place in included.items()}
        build_data["force_include"][str(record)] = RECORD
        build_data["pure_python"], build_data["infer_tag"] = False, True

    def finalize(self, *_: object) -> None:
        """Remove what was compiled, which is in the wheel by now."""
        shutil.rmtree(getattr(self, "_directory", ""), ignore_errors=True)


class Problem(Exception):  # noqa: N818 - not an error: the wheel is built without it
    """Why nothing was compiled."""


def matches(root: Path, globs: list[str]) -> set[Path]:
    """Return the files that one of these globs names."""
    return {path for glob in globs for path in root.glob(glob)}


def is_asked_for() -> bool:
    """Return whether the environment asks for a compiled core."""
    return os.environ.get("HIL_BENCH_COMPILE", "0") not in {"", "0"}


def record_of(root: Path, names: list[str]) -> dict[str, Any]:
    """Return what was compiled: the compiler, and a digest of each source."""
    digests = {name: hashlib.sha256((root / name).read_bytes()).hexdigest() for name in names}
    return {"mypyc": importlib.metadata.version("mypy"), "modules": digests}


def compile_modules(root: Path, names: list[str], built: Path) -> None:
    """Compile modules into `built`/lib.

    Args:
        root: of the project.
        names: of the sources, from there.
        built: an empty directory.

    Raises:
        Problem: there is no compiler, or it refuses.
    """
    from mypyc.build import mypycify  # noqa: PLC0415 - there only where it is asked for
    from setuptools import Distribution  # noqa: PLC0415
    from setuptools.command.build_ext import build_ext  # noqa: PLC0415
    from setuptools.errors import CompileError, LinkError, PlatformError  # noqa: PLC0415

    class InParallel(build_ext):
        """Compiles as many files at once as there are processors."""

        def build_extensions(self) -> None:
            """Build all extensions."""
            one_after_another = self.compiler.compile

            def compile_all(files: list[str], **options: Any) -> list[str]:  # noqa: ANN401
                with ThreadPoolExecutor(os.cpu_count()) as pool:
                    made = pool.map(lambda file: one_after_another([file], **options), files)
                    return [name for names in made for name in names]

            self.compiler.compile = compile_all
            super().build_extensions()

    options = ["--config-file=", "--ignore-missing-imports", "--follow-imports=silent"]
    options += [
        f"--cache-dir={built / 'cache'}",
        f"--python-version={sys.version_info[0]}.{sys.version_info[1]}",
    ]
    here = Path.cwd()
    os.chdir(root)
    try:
        extensions = mypycify(
            [*options, *names],
            opt_level="2",
            debug_level="0",
            multi_file=True,
            group_name=GROUP,
            target_dir=str(built / "c"),
        )
        command = InParallel(Distribution({"name": GROUP, "ext_modules": extensions}))
        command.build_lib, command.build_temp = str(built / "lib"), str(built / "objects")
        command.ensure_finalized()
        command.run()
    except (CompileError, LinkError, PlatformError, SystemExit) as error:
        raise Problem(str(error) or "mypyc refuses the sources") from error
    finally:
        os.chdir(here)
