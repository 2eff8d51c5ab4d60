"""The way of a parameter from `bench.toml` to the plant's constants, in modules and returns.

    python benchmarks/walk.py                        # of this tree
    PYTHONPATH=CHECKOUT python benchmarks/walk.py    # of another

A bench whose file has one key, `supply_pressure_bar`, is loaded and built. A function is on the way
where the value is a variable of it, or where it names the value and so takes it from a record. Each
function counts once, when it is first called. A room is a module; a return is a function in a room
that the way had left. In brackets: with the functions that have a record in hand in which the
value lies, and pass it on.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import FrameType
from typing import Any, Final

import occasion
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import load_config

BAR: Final = 123.4567
"""No other value of a bench."""

VALUES: Final = {BAR, BAR * 1e5}
NAMES: Final = {"P_S", "supply_pressure_bar"}


class Walk:
    """The functions on the way, by module and name, in the order of their first calls.

    Attributes:
        direct: those that have the value itself.
        all: with those that have a record of it.
    """

    def __init__(self) -> None:
        self.direct: dict[tuple[str, str], None] = {}
        self.all: dict[tuple[str, str], None] = {}

    def trace(self, frame: FrameType, _event: str, _arg: object) -> Any:  # noqa: ANN401 - its own type
        """Follow a function of the bench, line by line."""
        _, within, path = frame.f_code.co_filename.rpartition("hil_bench/")
        if not within:
            return None
        place = path, frame.f_code.co_name
        texts = {each for each in frame.f_code.co_consts if isinstance(each, str)}
        if NAMES & {*frame.f_code.co_names, *texts}:
            self.direct.setdefault(place)
            self.all.setdefault(place)

        def look(inner: FrameType, _event: str, _arg: object) -> Any:  # noqa: ANN401 - as above
            held = list(inner.f_locals.values())
            if any(_is(value) for value in held):
                self.direct.setdefault(place)
                self.all.setdefault(place)
            elif place not in self.all and any(map(_is_in, held)):
                self.all.setdefault(place)
            return look

        return look


def _is(value: object) -> bool:
    return type(value) is float and value in VALUES


def _is_in(record: object) -> bool:
    if isinstance(record, tuple):
        return any(map(_is, record))
    if is_dataclass(record) and not isinstance(record, type):
        return any(_is(getattr(record, each.name, None)) for each in fields(record))
    return False


def count(places: Iterable[tuple[str, str]]) -> tuple[int, int]:
    """Return the rooms and the returns of a way."""
    rooms: list[str] = []
    last, returns = "", 0
    for room, _ in places:
        returns += room != last and room in rooms
        rooms += [] if room in rooms else [room]
        last = room
    return len(rooms), returns


def main() -> None:
    """Print the way, and its rooms and returns."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    occasion.arguments(parser)
    walk = Walk()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.toml"
        path.write_text(f"[plant.axis1]\nsupply_pressure_bar = {BAR}\n", encoding="utf-8")
        build_bench(load_config(path))  # imports and caches
        sys.settrace(walk.trace)
        try:
            build_bench(load_config(path))
        finally:
            sys.settrace(None)
    for room, function in walk.direct:
        print(f"{room:55} {function}")
    (rooms, returns), (all_rooms, all_returns) = count(walk.direct), count(walk.all)
    print(f"\nrooms {rooms} ({all_rooms}), returns {returns} ({all_returns})")


if __name__ == "__main__":
    main()
