"""ELF files of Cortex-M programs: what is loaded where, and the names of functions."""

from bisect import bisect_right
from pathlib import Path
from struct import Struct, error
from typing import Final, NamedTuple

from hil_bench.errors import ControllerFileError

_HEADER: Final = Struct("<4sBBB9xHHIIIIIHHHHHH")
_PROGRAM: Final = Struct("<IIIIIIII")
_SECTION: Final = Struct("<IIIIIIIIII")
_SYMBOL: Final = Struct("<IIIBBH")
_ARM, _EXECUTABLE, _LOAD, _INTERPRETER, _SYMBOLS, _FUNCTION = 40, 2, 1, 3, 2, 2
_LARGEST = 1 << 28  # of a file [byte]
_SHOWN = 120  # characters of a name
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
        ControllerFileError: the file cannot be read or is no program for a Cortex-M.
    """
    try:
        if path.exists() and not path.is_file():  # a pipe would be waited for, a device has no end
            raise ControllerFileError(f"{path}: is no file; {_RIGHT}")
        if path.stat().st_size > _LARGEST:
            raise ControllerFileError(f"{path}: has more than {_LARGEST >> 20} MiB; {_RIGHT}")
        data = path.read_bytes()
    except OSError as fault:
        raise ControllerFileError(f"{path}: cannot be read: {fault.strerror or fault}") from fault
    try:
        return _read(data)
    except (error, IndexError, UnicodeDecodeError):
        raise ControllerFileError(f"{path}: is a damaged ELF file; {_RIGHT}") from None
    except ValueError as fault:
        raise ControllerFileError(f"{path}: {fault}; {_RIGHT}") from None


def _read(data: bytes) -> Program:
    """Read a program.

    Raises:
        IndexError: the file is damaged.
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
    if header[12] != _PROGRAM.size or header[14] not in {0, _SECTION.size}:
        raise IndexError
    segments = _read_segments(data, segments_at, header[13])
    starts, names = _read_functions(data, sections_at, header[15])
    return Program(segments, starts, names)


def _read_segments(data: bytes, segments_at: int, count: int) -> tuple[Segment, ...]:
    """Read what is to be flashed.

    Raises:
        IndexError: the file is damaged.
        ValueError: nothing of it can be flashed; the words say why.
    """
    segments, left = [], len(data)
    for number in range(count):
        what, offset, _, address, size, *_ = _PROGRAM.unpack_from(data, segments_at + 32 * number)
        if what == _INTERPRETER:
            raise ValueError("is a program for Linux, which the kind program runs")
        if what == _LOAD and size:
            if offset + size > len(data):
                raise ValueError("ends in the middle of what is to be flashed")
            left -= size
            if left < 0:  # bytes of the file that are flashed twice
                raise IndexError
            segments.append(Segment(address, data[offset : offset + size]))
    if not segments:
        raise ValueError("has nothing to be flashed")
    return tuple(segments)


def _read_functions(
    data: bytes, sections_at: int, count: int
) -> tuple[tuple[int, ...], tuple[str, ...]]:
    sections = [_SECTION.unpack_from(data, sections_at + 40 * place) for place in range(count)]
    found: dict[int, str] = {}
    symbols = next((each for each in sections if each[1] == _SYMBOLS), None)
    if symbols is not None:
        text_at, text_size = sections[symbols[6]][4:6]
        text = data[text_at : text_at + text_size]
        for place in range(symbols[4], symbols[4] + symbols[5], _SYMBOL.size):
            name_at, value, _, info, _, _ = _SYMBOL.unpack_from(data, place)
            if info & 0xF == _FUNCTION:
                found[value & ~1] = _name_at(text, name_at)
    starts = tuple(sorted(found))
    return starts, tuple(found[start] for start in starts)


def _name_at(text: bytes, at: int) -> str:
    name = text[at : max(text.find(0, at), at)][:_SHOWN].decode("utf-8", "replace")
    return "".join(letter if letter.isprintable() else "?" for letter in name)
