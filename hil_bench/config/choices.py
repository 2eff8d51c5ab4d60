"""The words that a key of the configuration may have, where it has a choice of some."""

from enum import StrEnum

FIRST_BUS = "bus"
"""Name of the bus of the table ``[bus]``."""


class Profile(StrEnum):
    """The device profiles that a node may have."""

    VALVE_408 = "valve_408"
    PRESSURE_404 = "pressure_404"
    ENCODER_406 = "encoder_406"
    GENERIC = "generic"
    """None: a device made from its EDS file alone."""


class PressureSource(StrEnum):
    """The cylinder port at which a pressure transducer sits, in the paper's symbols."""

    P_A = "P_A"
    P_B = "P_B"


class Quantity(StrEnum):
    """What an object can be bound to, by the names that recordings use."""

    POSITION = "position"
    SPEED = "speed"
    P_A = "P_A"
    P_B = "P_B"
    Q_A = "Q_A"
    Q_B = "Q_B"
    SPOOL_POSITION = "spool_position"
    SPOOL_SETPOINT = "spool_setpoint"


class Friction(StrEnum):
    """The models of the piston's friction."""

    STRIBECK = "stribeck"
    LUGRE = "lugre"


class Supply(StrEnum):
    """What stands behind port P."""

    CONSTANT = "constant"
    UNIT = "unit"


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
