"""Small programs for a Cortex-M, built by the tests themselves."""

import os
import shutil
import subprocess
from pathlib import Path

CAN_BUILD = "CI" in os.environ or shutil.which("arm-none-eabi-gcc") is not None
WHY_NOT = "needs gcc-arm-none-eabi and libnewlib-arm-none-eabi"
_HERE = Path(__file__).parent
_ROOT = _HERE.parents[1]
_EXAMPLE = _ROOT / "examples/firmware"
_INCLUDE = _ROOT / "hil_bench/abilities/controllers/library/include"


def build_for_chip(source: str, folder: Path, core: str = "cortex-m4") -> Path:
    """Return the ELF file of a program in C.

    Args:
        source: defines ``program``, where it begins, and by macros the functions of exceptions.
        folder: for it.
        core: as the compiler calls it; a cortex-m4 has floats.
    """
    text = f'#include "chip.h"\n{source}\n#include "chip_vectors.h"\n'
    (folder / "program.c").write_text(text)
    floats = ["-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"] if core == "cortex-m4" else []
    program = folder / "program.elf"
    words = f"arm-none-eabi-gcc -mcpu={core} -mthumb -O1 -g -Wall -Werror -nostdlib -ffreestanding"
    files = [f"-I{_HERE}", "-T", _HERE / "chip.ld", folder / "program.c", "-o", program]
    command = [*words.split(), *floats, *files, "-lgcc"]
    subprocess.run(command, check=True, capture_output=True)  # noqa: S603 - likewise
    return program


def build_example(folder: Path, *names: str) -> Path:
    """Build files of the example in C into a folder, which is returned."""
    make = ["make", "-s", "-C", _EXAMPLE, f"BUILD={folder}", f"HIL={_INCLUDE}"]
    goals = [folder / name for name in names]
    subprocess.run([*make, *goals], check=True, capture_output=True)  # noqa: S603 - our own program
    return folder
