"""Common parts of the kinds of devices that command the spool of their axis."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, TypeVar

from hil_bench.config.settings import Key, Problems, Settings
from hil_bench.config.values import number
from hil_bench.devices.kinds.kind import DeviceKind, NodeConfig
from hil_bench.plants.plant import AxisSettings
from hil_bench.units import MILLIMETRE, UNITS_OF

FULL_OPENING: Final = Key(
    "full_opening_mm", number(MILLIMETRE, low=0.001, high=1000.0), None, MILLIMETRE, "full_opening"
)
"""The key of the spool position at 100 %."""


@dataclass(frozen=True, slots=True)
class SpoolConfig(NodeConfig):
    """A device that commands a spool.

    Attributes:
        full_opening: spool position of 100 % [m]; None where the plant's command is no length.
    """

    full_opening: float | None


SpoolT = TypeVar("SpoolT", bound=SpoolConfig)


class SpoolKind(DeviceKind[SpoolT]):
    """A device that commands a spool; `FULL_OPENING` is among its keys."""

    is_drive = True

    def resolve(self, node: Settings, axis: AxisSettings) -> None:
        """Take the full opening from the plant where the table does not give it."""
        resolve_opening(node, axis)

    def full_scales(self, config: SpoolT) -> Mapping[str, float]:
        """Return the full opening [m], where there is one."""
        return scale_of(str(config.axis), config.full_opening)


def check_command(table: str, node: Settings, axis: AxisSettings, problems: Problems) -> None:
    """Note a plant that no valve commands, and a full opening where the command is no length."""
    kind = axis.kind
    if not kind.takes_valve:
        right = "give the node another profile or another axis"
        what = f"the plant is a {kind.name}, commanded in {kind.command.unit}, and no valve does so"
        problems.add(problems.place(table, "axis"), f"{what}; {right}")
    elif not _is_length(axis) and node[FULL_OPENING.name].value is not None:
        what = f"a {kind.name} is commanded in {kind.command_unit.symbol}; leave the key out"
        problems.add(problems.place(table, FULL_OPENING.name), what)


def resolve_opening(node: Settings, axis: AxisSettings) -> None:
    """Take the full opening from a plant that has one, where the table does not give it."""
    opening = node[FULL_OPENING.name]
    if opening.value is None and _is_length(axis):
        full = axis.kind.command_unit.to_si(axis.kind.full_scale(axis.settings))
        node[FULL_OPENING.name] = opening._replace(value=MILLIMETRE.from_si(full))


def scale_of(axis: str, full_opening: float | None) -> Mapping[str, float]:
    """Return a full opening [m] by its axis; without one the plant's own full scale counts."""
    return {} if full_opening is None else {axis: full_opening}


def _is_length(axis: AxisSettings) -> bool:
    return axis.kind.command_unit in UNITS_OF["m"]
