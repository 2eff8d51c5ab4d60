"""The hub in a process of its own, so that its Python does not hold up the loop's."""

from collections.abc import Sequence
from multiprocessing.connection import Connection
from typing import Self

from hil_bench.errors import BusError
from hil_bench.transports.child_process import ChildProcess
from hil_bench.transports.socketcand_hub import DEFAULT_PORT, run_hub


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

    Attributes:
        host: address it listens on.
        port: port it listens on; the actual one within the `with` block.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = DEFAULT_PORT,
        channels: Sequence[str] = ("can0",),
    ) -> None:
        self.host = host
        self.port = port
        self._child = ChildProcess(
            _run,
            (host, port, tuple(channels)),
            name="hil-bench-hub",
            label=f"hub {host}:{port}",
        )

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._child.alive

    def __enter__(self) -> Self:
        """Start the process and wait until clients may connect; `BusError` where none can."""
        self.port = self._child.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._child.stop()


def _run(host: str, port: int, channels: Sequence[str], connection: Connection) -> None:
    """Run a hub in this process, which is the child, and report its port or why there is none."""
    try:
        run_hub(host, port, connection.send, channels)
    except (BusError, ValueError) as error:
        connection.send(str(error))
