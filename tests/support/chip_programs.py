"""Small programs for a Cortex-M, built by the tests themselves."""

import os
import shutil
import subprocess
from pathlib import Path

CAN_BUILD = "CI" in os.environ or shutil.which("arm-none-eabi-gcc") is not None
WHY_NOT = "needs gcc-arm-none-eabi and libnewlib-arm-none-eabi"
_ROOT = Path(__file__).parents[2]
_EXAMPLE = _ROOT / "examples/firmware"
_INCLUDE = _ROOT / "hil_bench/abilities/controllers/library/include"

_LINK = """
MEMORY {
  FLASH (rx) : ORIGIN = 0x08000000, LENGTH = 64K
  RAM (rw) : ORIGIN = 0x20000000, LENGTH = 4K
}
SECTIONS {
  .text : { KEEP(*(.vectors)) *(.text*) *(.rodata*) } > FLASH
  .bss (NOLOAD) : { *(.data*) *(.bss* COMMON) } > RAM
}
"""
# Registers, and a vector table of the functions that a program names by macros.
_HEAD = """
#include <stdint.h>
#define R32(address) (*(volatile uint32_t *)(address))
#define R8(address) (*(volatile uint8_t *)(address))
#define CAN1 0x40006400u
static void put(char c) { R32(0x40004404) = (uint8_t)c; }            /* USART2 of an F4 */
static __attribute__((unused)) void say(const char *text) { while (*text) put(*text++); put(10); }
static __attribute__((unused)) void pend(unsigned n)
{ R32(0xE000E200) = 1u << n; __asm volatile("dsb\\nisb"); }
static __attribute__((unused)) void allow(unsigned n, uint8_t priority)
{ R8(0xE000E400 + n) = priority; R32(0xE000E100) = 1u << n; }
static __attribute__((unused)) void rest(void) { for (;;) __asm volatile("wfi"); }
void program(void);
"""
_TAIL = """
#ifndef SVC
#define SVC 0
#endif
#ifndef PENDSV
#define PENDSV 0
#endif
#ifndef SYSTICK
#define SYSTICK 0
#endif
#ifndef INTERRUPTS
#define INTERRUPTS
#endif
__attribute__((section(".vectors"), used)) static void (*const vectors[48])(void) = {
    (void (*)(void))0x20001000, program, [11] = SVC, [14] = PENDSV, [15] = SYSTICK, INTERRUPTS };
"""


def build_for_chip(source: str, folder: Path, core: str = "cortex-m4") -> Path:
    """Return the ELF file of a program in C.

    Args:
        source: defines ``program``, where it begins, and by macros the functions of exceptions.
        folder: for it.
        core: as the compiler calls it; a cortex-m4 has floats.
    """
    (folder / "program.c").write_text(_HEAD + source + _TAIL)
    (folder / "link.ld").write_text(_LINK)
    floats = ["-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"] if core == "cortex-m4" else []
    program = folder / "program.elf"
    subprocess.run(  # noqa: S603 - likewise
        [  # noqa: S607 - as people call it
            "arm-none-eabi-gcc",
            f"-mcpu={core}",
            "-mthumb",
            *floats,
            "-O1",
            "-g",
            "-Wall",
            "-Werror",
            "-nostdlib",
            "-ffreestanding",
            "-T",
            folder / "link.ld",
            folder / "program.c",
            "-o",
            program,
            "-lgcc",
        ],
        check=True,
        capture_output=True,
    )
    return program


def build_example(folder: Path, *names: str) -> Path:
    """Build files of the example in C into a folder, which is returned."""
    make = ["make", "-s", "-C", _EXAMPLE, f"BUILD={folder}", f"HIL={_INCLUDE}"]
    goals = [folder / name for name in names]
    subprocess.run([*make, *goals], check=True, capture_output=True)  # noqa: S603 - our own program
    return folder
