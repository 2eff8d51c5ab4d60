"""The kinds of devices: the core's, abilities', those of the entry points ``hil_bench.kinds``."""

from typing import Any, Final

from hil_bench.ability import given_to
from hil_bench.config.values import describe
from hil_bench.devices.kinds.bindings import CHAIN_TABLE
from hil_bench.devices.kinds.encoder_406 import ENCODER, REDUNDANT_ENCODER, ROTARY_ENCODER
from hil_bench.devices.kinds.kind import GENERIC, DeviceKind
from hil_bench.devices.kinds.pressure_404 import PRESSURE, TRANSDUCER
from hil_bench.devices.kinds.valve_408 import VALVE
from hil_bench.errors import ConfigError
from hil_bench.registry import Registry, find_twice

__all__ = ["ENCODER", "GENERIC", "KINDS", "PRESSURE", "TRANSDUCER", "VALVE", "kind_name", "kind_of"]

_COMMON_KEYS = (
    *("profile", "node_id", "bus", "axis", "eds", "storage", "serial_number", "objects"),
    CHAIN_TABLE,
)


def _find_fault(kind: DeviceKind[Any]) -> str:
    """Return the first fault of a kind from elsewhere; empty if it has no fault."""
    if twice := find_twice((*_COMMON_KEYS, *(key.name for key in kind.keys))):
        return f"has the key {twice} twice; every node has {', '.join(_COMMON_KEYS)}"
    for what, path in (("EDS file", kind.eds), ("register map", kind.registers)):
        if path is not None and not path.is_file():
            return f"lacks its {what}: there is no {path}"
    return ""


KINDS: Final = Registry[DeviceKind[Any]](
    "hil_bench.kinds",
    DeviceKind,  # type: ignore[type-abstract]
    {
        kind.name: kind
        for kind in (
            *(VALVE, PRESSURE, TRANSDUCER, ENCODER, REDUNDANT_ENCODER, ROTARY_ENCODER),
            *(kind for module in given_to("kinds") for kind in module.KINDS),
            GENERIC,
        )
    },
    _find_fault,
)


def kind_of(name: object) -> DeviceKind[Any]:
    """Return the kind of a name.

    Raises:
        ConfigError: there is none, or its distribution does not have it.
    """
    kind = KINDS.find(name) if isinstance(name, str) else None
    if kind is None:
        known = ", ".join(f'"{known}"' for known in KINDS.names())
        raise ConfigError(f"{describe(name)} is unknown; give one of {known}")
    return kind


def kind_name(value: object) -> str:
    """Return the name of a kind; see `kind_of`."""
    return kind_of(value).name
