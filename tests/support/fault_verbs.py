"""The signatures of the verbs of faults, for type checkers; run as a program, it writes them."""

import inspect
from pathlib import Path

from hil_bench.abilities.faults import verbs
from hil_bench.abilities.faults.kind import FaultKind
from hil_bench.abilities.faults.registry import FAULT_KINDS

FILE = Path(verbs.__file__).with_suffix(".pyi")
HEAD = """# Written by tests/support/fault_verbs.py from the kinds of faults.
# ruff: noqa: E501, ANN401, PYI001
# fmt: off
from typing import Any, Generic, TypedDict, TypeVar, Unpack

F = TypeVar("F")

class When(TypedDict, total=False):
    at: float | None
    duration: float | None

class Verbs(Generic[F]):
    def __getattr__(self, name: str, /) -> Any: ...
"""
"""A kind of another distribution is any callable."""


def signatures() -> str:
    """Return the text of the file."""
    own = FAULT_KINDS.built_in.values()
    return HEAD + "".join(f"    def {kind.name}({_parameters(kind)}) -> F: ...\n" for kind in own)


def _parameters(kind: FaultKind) -> str:
    first, *others = inspect.signature(kind.make).parameters.values()
    parts = ["self", f"{first.name}: str", *map(_parameter, others)]
    named = [place for place, each in enumerate(others, 2) if each.kind is each.KEYWORD_ONLY]
    if named:
        parts.insert(named[0], "*")
    return ", ".join([*parts, "**when: Unpack[When]"])


def _parameter(each: inspect.Parameter) -> str:
    hint = inspect.formatannotation(each.annotation)
    word = "str" if hint.endswith("str") else hint  # members of the enumerations are words
    return f"{each.name}: {word}{'' if each.default is each.empty else ' = ...'}"


if __name__ == "__main__":
    FILE.write_text(signatures(), encoding="utf-8")
