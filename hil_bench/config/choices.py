"""The words that a key of the configuration may have, where it has a choice of some."""

from enum import StrEnum

FIRST_BUS = "bus"
"""Name of the bus of the table ``[bus]``."""


class RealtimePolicy(StrEnum):
    """How the operating system schedules a paced loop."""

    OFF = "off"
    FIFO = "fifo"
    DEADLINE = "deadline"


class OverrunPolicy(StrEnum):
    """What a paced loop does after a tick that took longer than its period."""

    COUNT = "count"
    SKIP = "skip"
    STOP = "stop"
