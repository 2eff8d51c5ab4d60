"""The network list of an NMT master, and what comes of booting it (CiA 302-2)."""

from dataclasses import dataclass
from enum import Enum

from hil_drivers.concise_dcf import ConciseEntry


class BootError(Enum):
    """Why a slave was not booted: the error status of CiA 302-2, by its letter."""

    A = "it is not in the network list"
    B = "no answer to 0x1000 (device type)"
    C = "wrong device type (0x1000)"
    D = "wrong vendor-ID (0x1018.01)"
    E = "no heartbeat: its state is not known"
    F = "no answer to node guarding: its state is not known"
    G = "program download is not configured, or not consistently"
    H = "needs a software update, which is not allowed"
    I = "program download failed"  # noqa: E741 - the standard's letter
    J = "configuration failed"
    K = "no heartbeat when error control was started"
    L = "was OPERATIONAL already, and is left so"
    M = "wrong product code (0x1018.02)"
    N = "wrong revision number (0x1018.03)"
    O = "wrong serial number (0x1018.04)"  # noqa: E741 - the standard's letter


class Start(Enum):
    """The way in which slaves are started (0x1F80, bits 1 and 3)."""

    EACH = "each"
    """The master, each one as soon as it is booted."""
    ALL = "all"
    """The master, by one command when all mandatory slaves are booted."""
    NONE = "none"
    """The application: the master leaves them in PRE-OPERATIONAL."""


class Loss(Enum):
    """The reaction to the loss of a mandatory slave (0x1F80, bits 4 and 6)."""

    SLAVE = "slave"
    """The slave alone is booted anew."""
    RESET_ALL = "reset all"
    """All nodes are reset, and the network is booted anew."""
    STOP_ALL = "stop all"
    """All nodes are stopped, and stay so."""


@dataclass(frozen=True, slots=True)
class Slave:
    """An entry of the network list; what must be 0 or less than 1 is then not looked at.

    Attributes:
        node_id: 1 to 127.
        name: for people; empty for none.
        mandatory: whether the network is started with it only (0x1F81, bit 3).
        boots: whether the master checks, configures and starts it (bit 2); otherwise it only
            watches its heartbeat.
        keep_alive: whether it is not reset while OPERATIONAL (bit 4).
        device_type: that 0x1000 must hold (0x1F84); 0 for any.
        identity: vendor-ID, product code, revision and serial number that 0x1018.01 to .04 must
            hold (0x1F85 to 0x1F88); 0 for any.
        configuration: what is written to it (0x1F22).
        date: expected configuration date, days since 1984-01-01 (0x1F26); 0 for none.
        time: expected configuration time, ms after midnight (0x1F27).
        store: whether it is told to store its configuration (0x1010.01).
        restore: sub-index of 0x1011 by which it restores defaults before it is configured
            (0x1F8A); 0 for none.
        heartbeat_time: within which each of its heartbeats must follow the last [s] (0x1016 of the
            master); 0 for no error control.
    """

    node_id: int
    name: str = ""
    mandatory: bool = True
    boots: bool = True
    keep_alive: bool = False
    device_type: int = 0
    identity: tuple[int, int, int, int] = (0, 0, 0, 0)
    configuration: tuple[ConciseEntry, ...] = ()
    date: int = 0
    time: int = 0
    store: bool = False
    restore: int = 0
    heartbeat_time: float = 0.0

    def __str__(self) -> str:
        return f"node {self.node_id}" + (f" ({self.name})" if self.name else "")


@dataclass(frozen=True, slots=True)
class Startup:
    """The settings by which the master boots the network.

    Attributes:
        start: who starts the slaves.
        loss: what follows when a mandatory slave is lost.
        boot_time: longest time until all mandatory slaves are booted [s] (0x1F89); 0 for no end.
    """

    start: Start = Start.EACH
    loss: Loss = Loss.SLAVE
    boot_time: float = 0.0


class Configured(Enum):
    """The way in which a slave came to its configuration."""

    NOTHING = "nothing to configure"
    WRITTEN = "written"
    KEPT = "kept, its date and time are the expected ones"


@dataclass(frozen=True, slots=True)
class BootResult:
    """The result of booting one slave.

    Attributes:
        slave: the slave.
        error: what the standard calls it; None where it was booted.
        reason: what happened, in words; empty where it was booted.
        configured: how it came to its configuration.
    """

    slave: Slave
    error: BootError | None
    reason: str = ""
    configured: Configured = Configured.NOTHING

    @property
    def is_up(self) -> bool:
        """Return True if the slave takes part: it is booted, or was OPERATIONAL already."""
        return self.error in {None, BootError.L}

    def __str__(self) -> str:
        if self.error is None:
            writes = len(self.slave.configuration)
            told = self.configured.value
            if self.configured is Configured.WRITTEN:
                told = f"{writes} object{'' if writes == 1 else 's'} {told}"
            return f"{self.slave}: booted, {told}"
        text = f"{self.slave}: error {self.error.name}, {self.error.value}"
        return f"{text}: {self.reason}" if self.reason else text
