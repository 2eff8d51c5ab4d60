"""Compiles the core of the bench and the plant's kernels into the wheel, where that is asked for.

    HIL_BENCH_COMPILE=1 pip install .

Without that variable, in an editable installation, and where there is no C compiler, the wheel is
pure Python and does the same, slower. mypyc compiles the core, whose modules `pyproject.toml`
names; Numba compiles the kernels ahead of time (`kernels`), on x86-64 only; the C compiler makes
what calls controllers of the kind `library` and the simulator of those of the kind `elf`, and on
Linux the library that those of the kind `program` are run with. Where one of them fails the wheel
has the others. It says in `hil_bench/compiled.json` of which sources the core was made.
"""

import hashlib
import importlib.metadata
import importlib.util
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

GROUP = "hil_bench_core"
RECORD = "hil_bench/compiled.json"
REQUIREMENTS = [
    "mypy>=2.4,<3",
    "numba>=0.61; platform_machine == 'x86_64' and python_version < '3.15'",
    "setuptools>=70",
]
NO_KERNELS = "the plant's kernels are not compiled: {}; Numba does it at run time"
NO_PRELOAD = "the library of programs is not compiled: {}; a first run does it"
NO_CALLS = "calls are not compiled: {}; ctypes or a first run does it"
CALLS = {
    "hil_bench.abilities.controllers.elf._calls": "hil_bench/abilities/controllers/elf/core/*.c",
    "hil_bench.abilities.controllers.library._call": "hil_bench/abilities/controllers/library/*.c",
}
PROGRAM = "hil_bench/abilities/controllers/program"
KERNELS = "hil_bench.plants.hydraulic_cylinder.model._kernels"


class CompiledCore(BuildHookInterface):  # type: ignore[type-arg]
    """Adds the compiled modules and kernels to a wheel."""

    def dependencies(self) -> list[str]:
        """Return what a compiling build needs, nothing for any other."""
        return REQUIREMENTS if is_asked_for() else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and have the wheel carry it; a wheel without what fails."""
        if version == "editable" or not is_asked_for():
            return
        self._directory = tempfile.mkdtemp()
        root, built = Path(self.root), Path(self._directory)
        sources = matches(root, self.config["modules"]) - matches(root, self.config["uncompiled"])
        names = sorted(path.relative_to(root).as_posix() for path in sources)
        included = build_data["force_include"]
        try:
            compile_modules(root, names, built / "core")
        except Problem as problem:
            self.app.display_warning(f"the core is not compiled: {problem}; it runs as Python")
        else:
            record = built / "compiled.json"
            text = json.dumps(record_of(root, names), indent=1) + "\n"
            record.write_text(text, encoding="utf-8")
            included[str(record)] = RECORD
        for part, compile_part, otherwise in (
            ("kernels", compile_kernels, NO_KERNELS),
            ("calls", compile_calls, NO_CALLS),
            ("preload", compile_preload, NO_PRELOAD),
        ):
            try:
                compile_part(root, built / part)
            except Problem as problem:
                self.app.display_warning(otherwise.format(problem))
        for part in ("core", "kernels", "calls", "preload"):
            place = built / part / "lib"
            included |= {str(path): str(path.relative_to(place)) for path in place.rglob("*.so")}
        if included:
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
        built: a directory to come.

    Raises:
        Problem: there is no compiler, or it refuses.
    """
    from mypyc.build import mypycify  # noqa: PLC0415 - there only where it is asked for

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
        if os.name == "posix":
            for extension in extensions:  # calls within the core need no table of symbols
                flags = extension.extra_compile_args
                extension.extra_compile_args = [*flags, "-fvisibility=hidden"]
        build_extensions(extensions, built)
    except SystemExit as error:
        raise Problem(str(error) or "mypyc refuses the sources") from error
    finally:
        os.chdir(here)


def compile_kernels(root: Path, built: Path) -> None:
    """Compile the plant's kernels into an extension module in `built`/lib.

    Args:
        root: of the project.
        built: a directory to come.

    Raises:
        Problem: for another processor, without Numba or a compiler, or where one of them refuses.
    """
    if platform.machine() != "x86_64":
        raise Problem(f"they are made for x86-64 only, and this is {platform.machine()}")
    if importlib.util.find_spec("numba") is None:
        raise Problem("there is no Numba")
    built.mkdir(parents=True)
    command = [sys.executable, str(root / "kernels" / "compile.py"), str(built)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - ours
    if done.returncode:
        last = done.stderr.strip().rpartition("\n")[2]
        raise Problem(f"Numba refuses: {last}")
    from setuptools import Extension  # noqa: PLC0415 - there only where it is asked for

    extension = Extension(
        KERNELS,
        [str(root / "kernels" / "_kernels.c")],
        include_dirs=[str(built)],
        extra_objects=sorted(map(str, built.glob("*.o"))),
        extra_compile_args=["-O2"],
        libraries=["m"],
    )
    build_extensions([extension], built)


def compile_calls(root: Path, built: Path) -> None:
    """Compile calls of controllers' libraries and of unicorn into extension modules in `built`/lib.

    `Problem` says that there is no compiler, or that it refuses.
    """
    from setuptools import Extension  # noqa: PLC0415 - there only where it is asked for

    extensions = [
        Extension(name, sorted(map(str, matches(root, [sources]))), extra_compile_args=["-O2"])
        for name, sources in CALLS.items()
    ]
    build_extensions(extensions, built)


def compile_preload(root: Path, built: Path) -> None:
    """Compile the library that is loaded before a program into `built`/lib.

    Raises:
        Problem: for another system, without a compiler, or where it refuses.
    """
    if not sys.platform.startswith("linux"):
        raise Problem("it is for Linux only")
    library = built / "lib" / PROGRAM / "_preload.so"
    library.parent.mkdir(parents=True)
    command = [sys.executable, str(root / PROGRAM / "compile.py"), str(library)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - ours
    if done.returncode:
        raise Problem(done.stderr.strip())


def build_extensions(extensions: list[Any], built: Path) -> None:
    """Build extension modules into `built`/lib.

    Raises:
        Problem: there is no compiler, or it refuses.
    """
    from setuptools import Distribution  # noqa: PLC0415 - there only where it is asked for
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

    command = InParallel(Distribution({"name": GROUP, "ext_modules": extensions}))
    command.build_lib, command.build_temp = str(built / "lib"), str(built / "objects")
    command.ensure_finalized()
    try:
        command.run()
    except (CompileError, LinkError, PlatformError) as error:
        raise Problem(str(error)) from error
