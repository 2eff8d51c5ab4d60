"""Common parts of the verbs that listen to a bus: opening it, duration, and Ctrl-C."""

import argparse
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from hil_bench.abilities.eyes.listener import Listener
from hil_bench.bench.configuration.records import BusConfig
from hil_bench.cli.exit_codes import interruption
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import LoggedFrame
from hil_bench.outside.transports.opening import open_can_bus
from hil_bench.outside.transports.socketcan import has_fd

_POLL = 0.1
_HEAR_FD = frozenset({"socketcan", "socketcand"})


def add_duration_argument(parser: argparse.ArgumentParser, what: str) -> None:
    """Add --duration.

    Args:
        parser: of the verb.
        what: it does meanwhile, as in "listen".
    """
    parser.add_argument(
        "--duration",
        type=float,
        default=math.inf,
        metavar="S",
        help=f"{what} for S seconds (default: until Ctrl-C)",
    )


def check_duration(args: argparse.Namespace) -> None:
    """Refuse a duration that cannot be meant.

    Raises:
        ConfigError: it is not positive.
    """
    if not args.duration > 0.0:
        raise ConfigError(f"--duration {args.duration:g}: give more than 0 s")


@contextmanager
def open_listener(settings: BusConfig) -> Iterator[Listener]:
    """Open a bus to listen to it, to CAN FD, too, where its driver hears that without being asked.

    Yields:
        Who hears it.
    """
    if settings.interface in _HEAR_FD and has_fd(str(settings.channel)) is not False:
        settings = replace(settings, fd=True)
    bus, what = open_can_bus(*settings.address)
    with bus:
        yield Listener(bus, what)


def heard(
    listener: Listener, duration: float, idle: Callable[[], object] = lambda: None
) -> Iterator[LoggedFrame]:
    """Hear a bus for a time, or until Ctrl-C.

    Args:
        listener: hears it.
        duration: how long [s].
        idle: is called now and then where nothing comes.

    Yields:
        Each frame.
    """
    end = time.monotonic() + duration
    with interruption() as interrupted:
        while not interrupted.requested and (left := end - time.monotonic()) > 0.0:
            logged = listener.hear(min(_POLL, left))
            if logged is None:
                idle()
            else:
                yield logged
