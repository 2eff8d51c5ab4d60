"""ELF files of Cortex-M programs: what is loaded where, and the names of functions."""

from bisect import bisect_right
from pathlib import Path
from struct import Struct, error
from typing import Final, NamedTuple

from hil_bench.errors import ConfigError

_HEADER: Final = Struct("<4sBBB9xHHIIIIIHHHHHH")
_PROGRAM: Final = Struct("<IIIIIIII")
_SECTION: Final = Struct("<IIIIIIIIII")
_SYMBOL: Final = Struct("<IIIBBH")
_ARM, _EXECUTABLE, _LOAD, _INTERPRETER, _SYMBOLS, _FUNCTION = 40, 2, 1, 3, 2, 2
_RIGHT = "give the .elf file that the linker for the chip made"


class Segment(NamedTuple):
    """A part of a program as it is flashed.

    Attributes:
        address: where it is flashed; its start-up code copies from there.
        data: the bytes.
    """

    address: int
    data: bytes


class Program(NamedTuple):
    """A program for a Cortex-M.

    Attributes:
        segments: to be flashed.
        starts: addresses of its functions, in order.
        names: of the functions.
    """

    segments: tuple[Segment, ...]
    starts: tuple[int, ...]
    names: tuple[str, ...]

    def function_at(self, address: int) -> str:
        """Return the function at an address, as in ``main+0x12``; the address where none is."""
        place = bisect_right(self.starts, address) - 1
        if place < 0 or address - self.starts[place] > 0x10000:
            return f"0x{address:08X}"
        offset = address - self.starts[place]
        return f"{self.names[place]}+0x{offset:X}" if offset else self.names[place]


def read_program(path: Path) -> Program:
    """Return the program of an ELF file.

    Raises:
        ConfigError: the file cannot be read or is no program for a Cortex-M.
    """
    try:
        data = path.read_bytes()
    except OSError as fault:
        raise ConfigError(f"{path}: cannot be read: {fault.strerror or fault}") from fault
    try:
        return _read(data)
    except (error, IndexError, UnicodeDecodeError):
        raise ConfigError(f"{path}: is a damaged ELF file; {_RIGHT}") from None
    except ValueError as fault:
        raise ConfigError(f"{path}: {fault}; {_RIGHT}") from None


def _read(data: bytes) -> Program:
    """Read a program.

    Raises:
        ValueError: it is none for a Cortex-M; the words say why.
    """
    if data[:4] != b"\x7fELF":
        raise ValueError("is no ELF file")
    if data[4:6] != b"\x01\x01":
        raise ValueError("is an ELF file of another size of word or order of bytes than a Cortex-M")
    header = _HEADER.unpack_from(data)
    kind, machine, segments_at, sections_at = header[4], header[5], header[8], header[9]
    if machine != _ARM:
        raise ValueError(f"is an ELF file for another core (machine {machine}, Arm is {_ARM})")
    if kind != _EXECUTABLE:
        raise ValueError("is an ELF file that is not linked to its addresses")
    segments = []
    for number in range(header[13]):
        what, offset, _, address, size, *_ = _PROGRAM.unpack_from(data, segments_at + 32 * number)
        if what == _INTERPRETER:
            raise ValueError("is a program for Linux, which the kind program runs")
        if what == _LOAD and size:
            if offset + size > len(data):
                raise ValueError("ends in the middle of what is to be flashed")
            segments.append(Segment(address, data[offset : offset + size]))
    if not segments:
        raise ValueError("has nothing to be flashed")
    starts, names = _read_functions(data, sections_at, header[15])
    return Program(tuple(segments), starts, names)


def _read_functions(
    data: bytes, sections_at: int, count: int
) -> tuple[tuple[int, ...], tuple[str, ...]]:
    sections = [_SECTION.unpack_from(data, sections_at + 40 * place) for place in range(count)]
    found: dict[int, str] = {}
    for section in sections:
        what, offset, size, link = section[1], section[4], section[5], section[6]
        if what != _SYMBOLS:
            continue
        text_at, text_size = sections[link][4:6]
        text = data[text_at : text_at + text_size]
        for place in range(offset, offset + size, _SYMBOL.size):
            name_at, value, _, info, _, _ = _SYMBOL.unpack_from(data, place)
            if info & 0xF == _FUNCTION:
                found[value & ~1] = text[name_at:].partition(b"\0")[0].decode("utf-8", "replace")
    starts = tuple(sorted(found))
    return starts, tuple(found[start] for start in starts)
