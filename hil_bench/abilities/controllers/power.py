"""The switch of a controller's power."""

from enum import StrEnum
from typing import Final

ONLY: Final = "controller"
"""Name of the one controller of a scenario."""


class Power(StrEnum):
    """The positions of the switch, as steps name them."""

    START = "start"
    KILL = "kill"
    RESTART = "restart"
