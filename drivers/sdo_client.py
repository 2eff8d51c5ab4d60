"""canopen's SDO client without its thread."""

import struct
from collections.abc import Callable

from canopen.objectdictionary import ObjectDictionary
from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

WaitFor = Callable[[Callable[[], bool], float], bool]
"""Waits until a condition holds (True) or a time [s] is over (False), receiving meanwhile."""

ANSWERS_KEPT = 256
"""Answers that may wait to be read; what comes beyond that is refused."""

_SDO_ABORT = 0x80


class PumpedSdoClient(SdoClient):
    """canopen's SDO client, waiting for its answers by receiving instead of on another thread."""

    def __init__(
        self, rx_cobid: int, tx_cobid: int, od: ObjectDictionary, wait_for: WaitFor
    ) -> None:
        super().__init__(rx_cobid, tx_cobid, od)  # type: ignore[no-untyped-call]  # canopen has none
        self._wait_for = wait_for
        self._multiplexer = bytes(3)

    def receive(self, data: bytes, now: float) -> bool:  # noqa: ARG002 - every handler is told the time
        """Take an answer of the server; False refuses it as malformed."""
        if len(data) != 8 or self.responses.qsize() >= ANSWERS_KEPT:
            return False
        self.responses.put(data)
        return True

    def send_request(self, request: bytes) -> None:
        """Send a request, at once and once."""
        if request[0] >> 5 in {1, 2}:  # initiate download, initiate upload
            self._multiplexer = bytes(request[1:4])
        self.network.send_message(self.rx_cobid, request)

    def read_response(self) -> bytes:
        """Return the next answer.

        Raises:
            SdoAbortedError: the server aborted the transfer.
            SdoTimeout: it did not answer in time.
        """
        if not self._wait_for(lambda: not self.responses.empty(), self.RESPONSE_TIMEOUT):
            raise SdoTimeout
        response: bytes = self.responses.get_nowait()
        if response[0] == _SDO_ABORT:
            raise SdoAbortedError(struct.unpack_from("<L", response, 4)[0])
        return response

    def abort(self, abort_code: int = 0x08000000) -> None:
        """Tell the server that the present transfer is over."""
        self.send_request(struct.pack("<B3sL", _SDO_ABORT, self._multiplexer, abort_code))


class SdoTimeout(SdoCommunicationError):  # noqa: N818 - only `Node` meets it
    """No answer in time; told apart because the caller gets another error for it."""
