"""The hub in a process of its own, so that its Python does not hold up the loop's."""

import logging
import secrets
from collections.abc import Mapping, Sequence
from multiprocessing.connection import Connection
from typing import Self

from hil_bench.abilities.hub.server import HubLimits, run_hub
from hil_bench.abilities.hub.transport import HubTransport
from hil_bench.errors import BusError
from hil_bench.outside.bits import USUAL_BITRATE
from hil_bench.outside.processes.helper_process import ChildProcess
from hil_bench.outside.transports.socketcand_protocol import DEFAULT_PORT


class HubProcess:
    """A running hub, as a context manager.

    Its use::

        with HubProcess(port=0) as hub:
            can.Bus(interface="socketcand", channel="can0", host=hub.host, port=hub.port)

    It ends with the `with` block, and when its parent process dies; Ctrl-C is left to the parent.

    Args:
        host: address to listen on; "127.0.0.1" keeps the bus on this machine.
        port: 0 takes a free one.
        channels: names that clients may open, one bus each.
        bitrate: that limits what each client sends [bit/s]; None for no limit.
        fd: channels of CAN FD; how many times faster the data phase is on each.

    Attributes:
        host: address it listens on.
        port: port it listens on; the actual one within the `with` block.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = DEFAULT_PORT,
        channels: Sequence[str] = ("can0",),
        *,
        bitrate: float | None = USUAL_BITRATE,
        fd: Mapping[str, float] | None = None,
    ) -> None:
        self.host = host
        self.port = port
        self._channels = tuple(channels)
        self._limits = HubLimits(bitrate, secrets.token_hex(8), fd or {})
        self._child = self._make_child()

    @property
    def alive(self) -> bool:
        """Return True if the process runs."""
        return self._child.alive

    def __enter__(self) -> Self:
        """Start the process and wait until clients may connect; `BusError` where none can."""
        self.port = self._child.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._child.stop()

    def join(self, channel: str) -> HubTransport:
        """Return a bench's end of one of its buses, not limited; `BusError` where there is none."""
        limits = self._limits
        speedup = limits.fd.get(channel, 1.0)
        return HubTransport((self.host, self.port), channel, limits.owner, speedup)

    def ending(self) -> str | None:
        """Describe how the process ended, as in "was killed (SIGKILL)"; None while it runs."""
        return self._child.ending()

    def restart(self) -> None:
        """Start a hub at the same port in the place of one that has ended; `BusError` as before."""
        self._child.stop()
        self._child = self._make_child()
        self._child.start()

    def _make_child(self) -> ChildProcess:
        level = logging.getLogger().getEffectiveLevel()
        return ChildProcess(
            _run,
            (self.host, self.port, self._channels, self._limits, level),
            name="hil-bench-hub",
            label=f"hub {self.host}:{self.port}",
        )


def _run(
    host: str,
    port: int,
    channels: Sequence[str],
    limits: HubLimits,
    level: int,
    connection: Connection,
) -> None:
    """Run a hub in this process, which is the child, and report its port or why there is none."""
    logging.basicConfig(level=level, format="hil-bench: %(message)s")
    try:
        run_hub(host, port, connection.send, channels, limits)
    except (BusError, ValueError) as error:
        connection.send(str(error))
