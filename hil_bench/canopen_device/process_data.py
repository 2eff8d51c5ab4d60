"""Process data of one node (CiA 301): all PDOs, and the SYNC that they follow."""

from collections.abc import Iterator

from hil_bench.canopen_device.agenda import Agenda
from hil_bench.canopen_device.emcy import EmcyProducer
from hil_bench.canopen_device.events import NodeEvents
from hil_bench.canopen_device.frame import Emit, Frame, Handler
from hil_bench.canopen_device.nmt import COMMUNICATING, NmtState
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.pdo_mapping import Direction
from hil_bench.canopen_device.pdo_parameters import COMMUNICATION_INDICES, PdoParameters
from hil_bench.canopen_device.rpdo import Rpdo
from hil_bench.canopen_device.service import NodeCounters, Service
from hil_bench.canopen_device.sync import SyncConsumer, SynchronousWindow, SyncProducer
from hil_bench.canopen_device.tpdo import TpdoProducer


class ProcessData(Service):
    """Lets each SYNC act on the RPDOs first, then on the TPDOs.

    Attributes:
        sync: the consumer of SYNC.
        tpdos: the transmit PDOs.
    """

    def __init__(
        self,
        object_dictionary: ObjectDictionary,
        agenda: Agenda,
        events: NodeEvents,
        emcy: EmcyProducer,
        counters: NodeCounters,
    ) -> None:
        window = SynchronousWindow()
        self._counters = counters
        self._is_communicating = False
        self.sync = SyncConsumer(object_dictionary, window, emcy, counters)
        self._producer = SyncProducer(object_dictionary, agenda)
        self._rpdos = tuple(
            Rpdo(
                PdoParameters(object_dictionary, index, Direction.RPDO),
                agenda,
                window,
                events,
                emcy,
                counters,
            )
            for index in object_dictionary.indices(COMMUNICATION_INDICES[Direction.RPDO])
        )
        self.tpdos = TpdoProducer(object_dictionary, window, counters)

    def handlers(self) -> Iterator[tuple[int | None, Handler]]:
        """Yield those of PDOs, then that of SYNC: an RPDO acts with a SYNC of its identifier."""
        for can_id in self.tpdos.can_ids:
            yield can_id, self.tpdos.receive
        for rpdo in self._rpdos:
            yield rpdo.can_id, rpdo.receive
        yield self.sync.can_id, self._receive_sync

    def enter(self, state: NmtState) -> None:
        """Begin or end to take and send PDOs and SYNC."""
        is_operational = state is NmtState.OPERATIONAL
        self._is_communicating = state in COMMUNICATING
        for rpdo in self._rpdos:
            rpdo.set_operational(is_operational=is_operational)
        self.tpdos.set_operational(is_operational=is_operational)
        self._producer.set_enabled(is_enabled=self._is_communicating)

    def reset(self, node_id: int) -> None:  # noqa: ARG002 - identifiers come from the objects
        """Begin anew after the parameters got their power-on values."""
        self.sync.reset()
        for rpdo in self._rpdos:
            rpdo.reset()
        self.tpdos.reset()

    def serve(self, now: int, emit: Emit) -> int:  # noqa: ARG002 - `tpdos` sends, before the rest
        """Return when SYNC is to be produced, or an RPDO times out [ns]."""
        return min((self._producer.due, *(rpdo.due for rpdo in self._rpdos)))

    def expire(self, now: int) -> None:
        """Produce the SYNC that is due, and report the RPDOs that failed to come in time."""
        sync = self._producer.expire(now)
        if sync is not None:
            self._synchronise(sync.data, now, sync)
        for rpdo in self._rpdos:
            rpdo.expire(now)

    def _receive_sync(self, frame: Frame, now: int) -> None:
        _, data, is_remote, is_extended, _, _ = frame
        if is_remote or is_extended:
            self._counters.ignored_frames += 1
        elif self._is_communicating and not self._producer.is_producing:
            self._synchronise(data, now)

    def _synchronise(self, data: bytes, now: int, own: Frame | None = None) -> None:
        """Act on a SYNC; `own` is the frame where this node produces it.

        PDOs that still wait for their turn since the last SYNC keep the values that they had then.
        """
        if not self.tpdos.due:
            self.tpdos.settle(now)
        counter = self.sync.receive(data, now)
        for rpdo in self._rpdos:
            rpdo.synchronise()
        self.tpdos.synchronise(counter, own)
