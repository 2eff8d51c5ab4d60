"""Compiles the plant's kernels to object files, for the extension module that a wheel carries.

    python kernels/compile.py DIRECTORY

`hatch_build.py` runs it, with Numba, and links what it leaves in DIRECTORY with `_kernels.c`: an
object file of each kernel, and `kernels.h`, which says what they are. The code is that which Numba
would make at run time, but for the processor: any that has the instructions of `FEATURES`.
"""

import os
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
MODEL = "hil_bench.plants.hydraulic_cylinder.model"
ADVANCES = (
    "extended_midpoint.advance_extended_midpoint",
    "forward_euler.advance_forward_euler",
    "implicit_midpoint.advance_implicit_midpoint",
    "lined_midpoint.advance_lined_midpoint",
    "reduced_steps.advance_reduced_euler",
    "reduced_steps.advance_reduced_midpoint",
    "reduced_steps.advance_reduced_runge_kutta",
    "runge_kutta.advance_runge_kutta",
)
"""The stepping kernels, each with two rows."""
GROUP = "side_by_side.move_group"
"""That of several plants at once, with five."""

LEVEL = "x86-64"
FEATURES = ("sse4.2", "popcnt", "bmi", "bmi2", "avx", "avx2")
"""Beyond `LEVEL`. `_kernels.c` asks the processor for each, so gcc must know its name."""


def set_up_numba(directory: Path) -> None:
    """Have Numba compile for `LEVEL` and `FEATURES`, with nothing of the user's settings."""
    for name in [name for name in os.environ if name.startswith("NUMBA_")]:
        del os.environ[name]
    os.environ["NUMBA_CPU_NAME"] = LEVEL
    os.environ["NUMBA_CPU_FEATURES"] = ",".join(f"+{feature}" for feature in FEATURES)
    os.environ["NUMBA_CACHE_DIR"] = str(directory / "cache")


def compile_kernel(function: Any, signature: tuple[Any, ...]) -> tuple[str, bytes]:  # noqa: ANN401 - a kernel
    """Compile a kernel as its dispatcher would, without what Python calls it by.

    Returns:
        The name of the function in the object file, and the object file.
    """
    import llvmlite.binding as llvm  # noqa: PLC0415 - Numba is set up before
    from numba.core import compiler  # noqa: PLC0415
    from numba.core.registry import cpu_target  # noqa: PLC0415

    flags = compiler.Flags()
    flags.nrt = True
    flags.error_model = "numpy"
    flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
    context = cpu_target.target_context
    made = compiler.compile_extra(
        cpu_target.typing_context, context, function.py_func, signature, None, flags, {}
    )
    target = llvm.Target.from_triple(llvm.get_process_triple())
    machine = target.create_target_machine(
        cpu=os.environ["NUMBA_CPU_NAME"],
        features=os.environ["NUMBA_CPU_FEATURES"],
        opt=3,
        reloc="pic",
        codemodel="default",
    )
    module = made.library._final_module  # noqa: SLF001 - there is no other way to it
    return made.fndesc.llvm_func_name, machine.emit_object(module)


def main(directory: Path) -> None:
    """Compile all kernels."""
    set_up_numba(directory)
    sys.path.insert(0, str(ROOT))
    import numba  # noqa: PLC0415 - set up before
    from numba import float64, int64  # noqa: PLC0415

    from hil_bench.plants.hydraulic_cylinder.model.kernel import ready  # noqa: PLC0415
    from hil_bench.plants.hydraulic_cylinder.model.machine_code import fingerprint  # noqa: PLC0415

    names = {}
    for path in (*ADVANCES, GROUP):
        place, _, kernel = path.partition(".")
        function = ready(getattr(import_module(f"{MODEL}.{place}"), kernel))
        rows, numbers = (5, (int64, int64)) if path == GROUP else (2, (float64, float64, int64))
        names[path], code = compile_kernel(function, (*[float64[::1]] * rows, *numbers))
        (directory / f"{kernel}.o").write_bytes(code)
    group = names.pop(GROUP)
    lines = [
        f'#define SOURCES "{fingerprint()}"',
        f'#define COMPILER "Numba {numba.__version__}"',
        f'#define LEVEL "{LEVEL} with {FEATURES[-1].upper()}"',
        "#define FEATURES(CHECK) " + " ".join(f'CHECK("{feature}")' for feature in FEATURES),
        f"#define MOVE_GROUP {group}",
        "extern MoveGroup MOVE_GROUP;",
        *(f"extern Advance {name};" for name in names.values()),
        "#define KERNELS(ENTRY) "
        + " ".join(f'ENTRY("{path.partition(".")[2]}", {name})' for path, name in names.items()),
    ]
    (directory / "kernels.h").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
