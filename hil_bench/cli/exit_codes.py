"""What the exit code of `hil-bench` says."""

from enum import IntEnum

from hil_bench.errors import (
    BusError,
    ConfigError,
    ControllerError,
    RecordingError,
    TimingError,
    WaitTimeoutError,
)


class ExitCode(IntEnum):
    """Exit codes of every verb; never a count and never an errno."""

    DONE = 0
    """The verb did what it was asked."""
    CHECK_FAILED = 1
    """The verb ran, and what it checked is not as it should be."""
    USAGE = 2
    """The command line, the configuration or a file is wrong."""
    BUS = 3
    """A bus or a port could not be opened, or was lost; a bench or a controller is silent."""
    TIMING = 4
    """The real-time budget was missed under ``--strict-timing`` or ``--overrun stop``."""
    LOST = 5
    """Something that was asked for was lost on the way: a recording, a Modbus server."""
    INCONCLUSIVE = 6
    """The verb ran, but what it was to check could not be seen."""
    INTERNAL = 70
    """A bug of hil-bench itself (EX_SOFTWARE of the BSD ``sysexits``)."""
    INTERRUPTED = 130
    """Ended by Ctrl-C before it was done (128 + SIGINT, as shells count)."""


def exit_code_of(error: Exception) -> ExitCode:
    """Return the exit code for an error that ended a verb."""
    match error:
        case ConfigError():
            return ExitCode.USAGE
        case BusError() | ControllerError() | WaitTimeoutError():
            return ExitCode.BUS
        case RecordingError():
            return ExitCode.LOST
        case TimingError():
            return ExitCode.TIMING
        case _:
            return ExitCode.INTERNAL
