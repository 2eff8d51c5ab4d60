"""A Modbus client's link whose other end is a bench in the same thread, for the demo and for tests.

Requests go through the same frames and the same server as on TCP and RTU. A read takes no bench
time; a write takes what the bench needs to obey it, during which its ticks run.
"""

from collections.abc import Callable
from typing import Any

from hil_bench.abilities.modbus.server.register_server import RegisterServer
from hil_bench.abilities.modbus.server.session import ModbusSession, serial_session, tcp_session


class EmbeddedLink:
    """A link for `hil_drivers.modbus.ModbusClient` to a server in the same process.

    Args:
        server: answers the requests.
        wait: lets bench time pass [s].
        period: of the ticks [s].
        framing: the client's, which finds its responses.
        is_serial: whether its frames are those of RTU.

    Attributes:
        description: how messages name it.
        framing: as passed in.
        is_cut: set it, and the link is lost, and cannot be opened until it is taken back.
    """

    def __init__(
        self,
        server: RegisterServer,
        wait: Callable[[float], None],
        period: float,
        *,
        framing: Any,  # noqa: ANN401 - a type of the drivers, which the bench does not know
        is_serial: bool,
    ) -> None:
        self.description = "embedded bench"
        self.framing = framing
        self.is_cut = False
        self.wait = wait
        self._server = server
        self._period = period
        self._make_session = serial_session if is_serial else tcp_session
        self._session: ModbusSession | None = None
        self._received = bytearray()
        self._reason = ""

    def open(self, timeout: float) -> None:  # noqa: ARG002 - it opens at once or not at all
        """Open it.

        Raises:
            ConnectionRefusedError: it is cut.
        """
        if self.is_cut:
            raise ConnectionRefusedError("the link is cut")
        self._session = self._make_session(
            self._server, self._received.extend, on_failure=self._take_reason
        )
        self._received.clear()

    def close(self) -> None:
        """Close it; a response that is still to come is lost."""
        if self._session is not None:
            self._session.end()
            self._session = None

    def send(self, data: bytes) -> None:
        """Hand a request to the server; `ConnectionResetError` where the link is closed by it."""
        self._check_open().receive(data)
        self._check_open()

    def receive(self, timeout: float) -> bytes:
        """Return the received bytes, after up to `timeout` seconds of ticks if there are none yet.

        `ConnectionResetError` where the link is cut or closed.
        """
        waited = 0.0
        while not self._received and waited < timeout:
            self._check_open()
            self.wait(self._period)
            self._server.poll()
            waited += self._period
        data = bytes(self._received)
        self._received.clear()
        return data

    def _check_open(self) -> ModbusSession:
        """Return the open session.

        Raises:
            ConnectionResetError: there is none.
        """
        if self.is_cut or self._session is None:
            raise ConnectionResetError("the link is cut")
        if self._session.is_over:
            raise ConnectionResetError(f"the server has closed the connection: {self._reason}")
        return self._session

    def _take_reason(self, reason: str) -> None:
        self._reason = reason
