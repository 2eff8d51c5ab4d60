"""One remote device: its EDS, its SDO server, its NMT state and its emergency messages.

`Node` is canopen's `RemoteNode`, so all of that class is at hand (`node.sdo[0x6131][1].raw`).
What differs is how it receives: canopen waits on a queue that a thread fills, `Node` is fed by its
network while the caller waits. What reaches it is checked first; a malformed message is refused,
never raised.
"""

import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from enum import IntEnum
from pathlib import Path
from typing import TypeVar

import canopen
from canopen.emcy import EMCY_STRUCT
from canopen.objectdictionary import ObjectDictionary, ObjectDictionaryError, ODVariable
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from hil_drivers.eds import load_eds
from hil_drivers.emergency import Emergency
from hil_drivers.errors import (
    DeviceMismatchError,
    DriverTimeoutError,
    RemoteProtocolError,
    SdoAbortError,
)
from hil_drivers.sdo_client import (
    Clock,
    PumpedSdoClient,
    SdoTimeout,
    SdoTooMuch,
    SdoTooSlow,
    WaitFor,
)

_T = TypeVar("_T")

EMERGENCIES_KEPT = 32
PROBES, PROBE_TIMEOUT = 20, 0.1
SEGMENT_BYTES = 7


class NmtState(IntEnum):
    """NMT state as a heartbeat message carries it (CiA 301)."""

    INITIALISING = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


class Node(canopen.RemoteNode):
    """A device on the bus as the controller sees it.

    Args:
        node_id: 1 to 127.
        eds: path of its EDS or DCF; None for a device of which nothing else is known.
        wait_for: how to wait while frames are being received.
        sdo_timeout: longest wait for each SDO answer [s]; `sdo.longest_transfer` bounds them all.
        clock: seconds on the network's clock.

    Attributes:
        node_id: as passed in.
        eds: as passed in.
        nmt_state: as in the last heartbeat or boot-up message, None before the first.
        heard_at: when that message came, on the network's clock [s].
        boot_ups: how often the device has said that it came up.
        emergencies: the last emergency messages, oldest first.
        active_emergency: the last one that no later "error reset" has taken back.
        before_download: called with index, sub-index and data before each write; None for nobody.

    Raises:
        ValueError: the node-ID is out of range.
    """

    def __init__(
        self,
        node_id: int,
        eds: Path | None,
        wait_for: WaitFor,
        *,
        sdo_timeout: float = 0.5,
        clock: Clock = time.monotonic,
    ) -> None:
        if not 1 <= node_id <= 127:
            raise ValueError(f"node-ID {node_id}: 1 to 127 is right (CiA 301)")
        self._wait_for = wait_for
        self._clock = clock
        super().__init__(node_id, load_eds(eds, node_id) if eds else _nothing_known())
        self.node_id = node_id
        self.eds = eds
        self.sdo.RESPONSE_TIMEOUT = sdo_timeout
        self.nmt_state: NmtState | None = None
        self.heard_at = -float("inf")
        self.boot_ups = 0
        self.emergencies: deque[Emergency] = deque(maxlen=EMERGENCIES_KEPT)
        self.active_emergency: Emergency | None = None
        self.before_download: Callable[[int, int, bytes], None] | None = None

    def __str__(self) -> str:
        return f"node {self.node_id}"

    def add_sdo(self, rx_cobid: int, tx_cobid: int) -> PumpedSdoClient:
        """Return a new SDO client; canopen calls this for the default SDO server."""
        client = PumpedSdoClient(
            rx_cobid, tx_cobid, self.object_dictionary, self._wait_for, self._clock
        )
        self.sdo_channels.append(client)
        return client

    def handlers(self) -> dict[int, Callable[[bytes, float], bool]]:
        """Return the handlers of this node's messages: COB-ID to handler(data, now)."""
        emergency_id = self.default(0x1014, otherwise=0x80 + self.node_id)
        return {
            0x700 + self.node_id: self.receive_heartbeat,
            emergency_id & 0x7FF: self.receive_emergency,
            self.sdo.tx_cobid: self.sdo.receive,
        }

    def receive_heartbeat(self, data: bytes, now: float) -> bool:
        """Take a heartbeat or boot-up message; False refuses it as malformed."""
        if len(data) != 1 or data[0] not in frozenset(NmtState):
            return False
        state = NmtState(data[0])
        if state is NmtState.INITIALISING:
            self.boot_ups += 1
            # A device that has booted up goes on without another message.
            state = NmtState.PRE_OPERATIONAL
        self.nmt_state = state
        self.heard_at = now
        self.nmt.on_heartbeat(0x700 + self.node_id, data, now)  # type: ignore[no-untyped-call]
        return True

    def receive_emergency(self, data: bytes, now: float) -> bool:
        """Take an emergency message; False refuses it as malformed."""
        if len(data) != EMCY_STRUCT.size:
            return False
        code, register, manufacturer = EMCY_STRUCT.unpack(data)
        emergency = Emergency(code, register, manufacturer, now)
        self.emergencies.append(emergency)
        self.active_emergency = None if emergency.is_reset else emergency
        return True

    def read_device_type(self) -> int:
        """Return 0x1000, waiting until the device answers: it may be booting up just now."""
        return self._patiently(lambda: self.read_integer(0x1000))

    def await_answer(self) -> None:
        """Wait until the device answers, whatever its EDS: it may be booting up just now."""
        self._patiently(lambda: self.upload(0x1000))

    def _patiently(self, read: Callable[[], _T]) -> _T:
        """Return the result of a read, repeated until the device answers.

        Raises:
            DriverTimeoutError: it did not within 2 s.
        """
        patience, self.sdo.RESPONSE_TIMEOUT = self.sdo.RESPONSE_TIMEOUT, PROBE_TIMEOUT
        try:
            for _ in range(PROBES):
                with suppress(DriverTimeoutError):
                    return read()
        finally:
            self.sdo.RESPONSE_TIMEOUT = patience
        raise DriverTimeoutError(
            f"no answer within {PROBES * PROBE_TIMEOUT:g} s; "
            "check node-ID, power, wiring and bit rate",
            device=self,
        )

    def variable(self, index: int, subindex: int = 0) -> ODVariable:
        """Return the EDS entry of an object.

        Raises:
            DeviceMismatchError: the EDS lacks it.
        """
        variable = self.object_dictionary.get_variable(index, subindex)
        if variable is None or variable.subindex != subindex:
            raise DeviceMismatchError(
                f"{self.eds} has no {object_name(index, subindex)}; "
                "the EDS of the connected device is right",
                device=self,
            )
        return variable

    def has(self, index: int, subindex: int = 0) -> bool:
        """Return True if the EDS has an object."""
        variable = self.object_dictionary.get_variable(index, subindex)
        return variable is not None and variable.subindex == subindex

    def default(self, index: int, subindex: int = 0, *, otherwise: int) -> int:
        """Return the integer that the EDS (or DCF) gives for an object, or `otherwise`."""
        if not self.has(index, subindex):
            return otherwise
        variable = self.variable(index, subindex)
        value = variable.default if variable.value is None else variable.value
        return value if isinstance(value, int) else otherwise

    def read(self, index: int, subindex: int = 0) -> int | float:
        """Return the number that the device holds in an object, read by SDO.

        Raises:
            DeviceMismatchError: the EDS lacks the object, or its type does not fit the answer.
        """
        variable = self.variable(index, subindex)
        raw = self.upload(index, subindex)
        try:
            value = variable.decode_raw(raw)
        except ObjectDictionaryError:
            value = None
        if not isinstance(value, int | float):
            raise DeviceMismatchError(
                f"{object_name(index, subindex)} ({variable.qualname}) came as "
                f"{len(raw)} bytes; {len(variable) // 8} are right by {self.eds}",
                device=self,
            )
        return value

    def read_integer(self, index: int, subindex: int = 0) -> int:
        """Return the integer that the device holds in an object; raise as `read` does.

        Raises:
            DeviceMismatchError: besides what `read` says, the EDS gives it no integer type.
        """
        value = self.read(index, subindex)
        if isinstance(value, float):
            raise DeviceMismatchError(
                f"{object_name(index, subindex)} is a real number by {self.eds}; "
                "an integer type is right",
                device=self,
            )
        return value

    def write(self, index: int, subindex: int, value: float) -> None:
        """Write a number to an object by SDO.

        Raises:
            ValueError: the value does not fit the object's type.
        """
        variable = self.variable(index, subindex)
        try:
            raw = variable.encode_raw(value)
        except ValueError as error:
            raise ValueError(
                f"{self}: {value} does not fit {object_name(index, subindex)} ({variable.qualname})"
            ) from error
        self.download(index, subindex, raw)

    def upload(self, index: int, subindex: int = 0) -> bytes:
        """Return the bytes of an object in the device, even of one that is not in the EDS.

        What it may bring at most, and how long it may take, say `sdo.most_bytes` and
        `sdo.longest_transfer`.
        """
        with self._sdo_errors("read", index, subindex):
            raw: bytes = self.sdo.upload(index, subindex)
        return raw

    def download(self, index: int, subindex: int, raw: bytes) -> None:
        """Write to an object of the device, whether or not the EDS knows it."""
        if self.before_download is not None:
            self.before_download(index, subindex, raw)
        with self._sdo_errors("write", index, subindex):
            self.sdo.download(index, subindex, raw)

    def download_stream(
        self,
        index: int,
        subindex: int,
        raw: bytes,
        *,
        block: bool = False,
        progress: Callable[[int], None] | None = None,
    ) -> None:
        """Write much to an object of the device, by block transfer or in segments.

        Args:
            index: of the object.
            subindex: of the object.
            raw: what to write.
            block: whether by block transfer.
            progress: told how many bytes have been sent.
        """
        if self.before_download is not None:
            self.before_download(index, subindex, raw)
        with self._sdo_errors("write", index, subindex):
            stream = self.sdo.open(
                index,
                subindex,
                "wb",
                buffering=0,
                size=len(raw),
                block_transfer=block,
                force_segment=True,
            )
            try:
                for start in range(0, len(raw), SEGMENT_BYTES):
                    stream.write(raw[start : start + SEGMENT_BYTES])
                    if progress is not None:
                        progress(min(start + SEGMENT_BYTES, len(raw)))
            except BaseException as error:
                # Closed as it is, the stream would go on with a transfer that is over.
                stream._done, stream._initialized = True, False  # noqa: SLF001
                if not isinstance(error, SdoAbortedError):
                    self.sdo.abort()
                raise
            finally:
                stream.close()

    @contextmanager
    def _sdo_errors(self, verb: str, index: int, subindex: int) -> Iterator[None]:
        """Turn the errors of canopen's SDO client into our own.

        Raises:
            SdoAbortError: the device refused.
            DriverTimeoutError: it did not answer.
            RemoteProtocolError: its answer is none, or has no end.
        """
        what = f"cannot {verb} {object_name(index, subindex)}"
        if self.has(index, subindex):
            what = f"{what} ({self.variable(index, subindex).qualname})"
        try:
            yield
        except SdoAbortedError as error:
            text = SdoAbortedError.CODES.get(error.code, "code unknown to CiA 301")
            raise SdoAbortError(what, error.code, text, device=self) from None
        except SdoTimeout:
            raise DriverTimeoutError(
                f"{what}: no SDO answer within {self.sdo.RESPONSE_TIMEOUT:g} s", device=self
            ) from None
        except SdoTooSlow:
            raise DriverTimeoutError(
                f"{what}: not over within {self.sdo.longest_transfer:g} s; it was aborted",
                device=self,
            ) from None
        except SdoTooMuch as error:
            raise RemoteProtocolError(f"{what}: {error}; it was aborted", device=self) from None
        except SdoCommunicationError as error:
            raise RemoteProtocolError(f"{what}: {error}", device=self) from None


def object_name(index: int, subindex: int = 0) -> str:
    """Return an object as the standards write it: 0x6041, 0x1018.01."""
    return f"0x{index:04X}.{subindex:02X}" if subindex else f"0x{index:04X}"


def _nothing_known() -> ObjectDictionary:
    """Return the object dictionary of a device without EDS."""
    return ObjectDictionary()  # type: ignore[no-untyped-call]  # canopen has no types
