"""Commands of a valve in place of CANopen while 0x604F (local) is 1.

It stands for the panel that a CiA 408 device may have; here a second bus, such as Modbus, is at it.
While it rules, an NMT state other than OPERATIONAL does not hold the valve, and 0x6040 and
0x6300.01 are not looked at.

Its set-point is watched as that of an RPDO: where no command came for the time of the watchdog, an
ACTIVE valve has a fault. Time 0 switches that off. In every other state silence is harmless.
"""

from dataclasses import dataclass


@dataclass(slots=True)
class LocalCommand:
    """The local control word and set-point, and when they came.

    Attributes:
        control_word: the last one.
        setpoint: spool set-point [increments].
        watchdog: longest time between two commands [ns]; 0 for any.
        received_at: when the last command came [ns].
    """

    control_word: int = 0
    setpoint: int = 0
    watchdog: int = 1_000_000_000
    received_at: int = 0

    def restart(self) -> None:
        """Forget what was commanded; the watchdog keeps its time."""
        self.control_word = 0
        self.setpoint = 0

    def is_late(self, now: int) -> bool:
        """Return True if the next command should have come by `now` [ns]."""
        return bool(self.watchdog) and now - self.received_at > self.watchdog
