"""What the kinds of devices share that command the spool of their axis."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, TypeVar

from hil_bench.config.settings import Key, Settings
from hil_bench.config.values import number
from hil_bench.kinds.kind import DeviceKind, NodeConfig
from hil_bench.plants.kind import AxisSettings
from hil_bench.units import MILLIMETRE

FULL_OPENING: Final = Key("full_opening_mm", number(MILLIMETRE), None, MILLIMETRE, "full_opening")
"""The key of the spool position at 100 %."""


@dataclass(frozen=True, slots=True)
class SpoolConfig(NodeConfig):
    """A device that commands a spool.

    Attributes:
        full_opening: spool position of 100 % [m].
    """

    full_opening: float


SpoolT = TypeVar("SpoolT", bound=SpoolConfig)


class SpoolKind(DeviceKind[SpoolT]):
    """A device that commands a spool; `FULL_OPENING` is among its keys."""

    is_drive = True

    def resolve(self, node: Settings, axis: AxisSettings) -> None:
        """Take the full opening from the orifices where the table does not give it."""
        opening = node[FULL_OPENING.name]
        if opening.value is None:
            full = axis.kind.full_scale(axis.settings)
            node[FULL_OPENING.name] = opening._replace(value=full)

    def full_scales(self, config: SpoolT) -> Mapping[str, float]:
        """Return the full opening [m]."""
        return {str(config.axis): config.full_opening}
