"""All kinds of faults by name, those of other distributions too."""

from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from typing import Final

from hil_bench.abilities.faults import line_kinds, plant_kinds
from hil_bench.abilities.faults.kind import LARGEST, FaultKind
from hil_bench.ability import given_to
from hil_bench.config.settings import Key
from hil_bench.config.values import describe, number, text
from hil_bench.errors import ConfigError
from hil_bench.registry import Registry, find_twice
from hil_bench.units import SECOND


class _Own(Mapping[str, FaultKind]):
    """Those of the bench and its abilities, imported when the first is asked for."""

    @cached_property
    def _kinds(self) -> dict[str, FaultKind]:
        modules = [plant_kinds, line_kinds, *given_to("faults")]
        found = [kind for module in modules for kind in vars(module).items()]
        return {name: kind for name, kind in found if isinstance(kind, FaultKind)}

    def __getitem__(self, name: str) -> FaultKind:
        return self._kinds[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._kinds)

    def __len__(self) -> int:
        return len(self._kinds)


def kind_name(value: object) -> str:
    """Return the name of a kind of fault.

    Raises:
        ConfigError: there is no such kind.
    """
    if isinstance(value, str) and FAULT_KINDS.find(value):
        return value
    known = ", ".join(f'"{name}"' for name in FAULT_KINDS.names())
    raise ConfigError(f"{describe(value)} is unknown; give one of {known}")


def _lasting(value: object) -> float:
    """Return the time for which a fault lasts [s].

    Raises:
        ConfigError: it is no number, out of range, or 0.
    """
    found: float = number(SECOND, low=0.0, high=LARGEST)(value)
    if not found:
        raise ConfigError("0 is no time; give how long the fault lasts, or leave the key out")
    return found


KIND_KEY: Final = Key("kind", kind_name, example='"freeze"')
LASTS_KEY: Final = Key("for_s", _lasting, None, SECOND, "duration")
COMMON_KEYS: Final = (
    KIND_KEY,
    Key("target", text, example='"pressure_a"'),
    Key("at_s", number(SECOND, low=0.0, high=LARGEST), 0.0, SECOND, "at"),
    LASTS_KEY,
)


def _find_fault(kind: FaultKind) -> str:
    """The fault of a kind from elsewhere; empty where there is none."""
    twice = find_twice(key.name for key in (*COMMON_KEYS, *kind.keys))
    return f"has the key {twice} twice; each needs a name of its own" if twice else ""


FAULT_KINDS: Final = Registry("hil_bench.faults", FaultKind, _Own(), _find_fault)
"""All kinds of faults."""


def find_fault_kind(name: object) -> FaultKind:
    """Return the kind of fault that has a name.

    Raises:
        ConfigError: there is no such kind.
    """
    if found := FAULT_KINDS.find(str(name)):
        return found
    right = f"give one of {', '.join(FAULT_KINDS.names())}"
    raise ConfigError(f'fault: there is no kind "{name}"; {right}')


def all_kinds() -> Iterator[FaultKind]:
    """Yield all kinds of faults; those of other distributions that cannot be used are left out."""
    yield from FAULT_KINDS.built_in.values()
    for each in FAULT_KINDS.extensions():
        if not each.problem and (kind := FAULT_KINDS.find(each.name)):
            yield kind


def missing_defect(kind: FaultKind, target: str, known: Iterable[str]) -> str:
    """Return why a plant or a supply cannot have a fault, and which ones it can have.

    Args:
        kind: of the fault.
        target: the name of the plant or supply.
        known: the defects that it can have.
    """
    known = set(known)
    can_have = [each.name for each in all_kinds() if known & {*each.defects.values()}]
    never = "cannot be worn: that takes a full-order cylinder and the bench's own solver"
    wrong = kind.lacks or (f"cannot have {kind.name}" if can_have else never)
    right = f"; it can have {', '.join(can_have)}" if can_have else ""
    return f"{target} {wrong}{right}"
