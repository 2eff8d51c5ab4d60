"""Transmit PDOs (CiA 301, process data objects): from the object dictionary to the bus."""

from functools import partial
from typing import Any

from hil_bench.canopen_device.agenda import NEVER
from hil_bench.canopen_device.frame import Emit, Frame, make_frame
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.pdo_parameters import (
    COMMUNICATION_INDICES,
    EVENT_DRIVEN,
    EVENT_DRIVEN_REMOTE,
    SYNCHRONOUS,
    SYNCHRONOUS_ACYCLIC,
    SYNCHRONOUS_REMOTE,
    Direction,
    PdoMapping,
    PdoParameters,
    Seal,
)
from hil_bench.canopen_device.service import NodeCounters
from hil_bench.canopen_device.sync import SynchronousWindow


class Tpdo:
    """One transmit PDO.

    Type 0 goes with the SYNC after an event, types 1 to 240 with every n-th SYNC, where the one
    with the SYNC start value as its counter is the first. Types 254 and 255 go on an event and when
    their event timer has run out, never sooner after the last than the inhibit time, and once on
    entering OPERATIONAL; a remote request counts as an event. Types 252 and 253 go on a remote
    request only: 252 with the values at the last SYNC, 253 with the present ones.

    Each SYNC and each remote request has a PDO of its own, even where several come in one round:
    `settle` and `answer` take the PDO that still waits before the next one counts.

    Attributes:
        can_id: its identifier, None while it is disabled.
        is_active: whether it is sent, in the present NMT state.
        due: when it is to be sent [ns]; NEVER while it is not active.
    """

    def __init__(
        self, parameters: PdoParameters, window: SynchronousWindow, counters: NodeCounters
    ) -> None:
        self.due = NEVER
        self._parameters = parameters
        self._window = window
        self._counters = counters
        self._is_operational = False
        self._inhibited_until = 0
        self._syncs = 0
        self._has_begun = False
        self._sample: bytes | None = None
        self._seal: Seal | None = None
        self.configure()

    def configure(self) -> None:
        """Follow the parameters; an event-driven PDO starts anew with a transmission."""
        self.can_id = self._parameters.can_id
        self._mapping = self._parameters.mapping()
        self._type = self._parameters.transmission_type
        self._is_event_driven = self._type in EVENT_DRIVEN
        self._is_synchronous = self._type in SYNCHRONOUS
        self._follows_sync = self._is_synchronous or self._type == SYNCHRONOUS_REMOTE
        self._allows_remote = self._parameters.allows_remote
        self._sync_start = self._parameters.sync_start
        self._event_time = self._parameters.event_time
        self._inhibit_time = self._parameters.inhibit_time
        self._begin()

    def protect(self) -> None:
        """Send it with a counter and a checksum from now on; see `pdo_protection`."""
        self._seal = Seal()

    def set_operational(self, *, is_operational: bool) -> None:
        """Begin or end to transmit."""
        self._is_operational = is_operational
        self._begin()

    def trigger(self) -> None:
        """Take an event of the application."""
        if self._is_event_driven and self.is_active:
            self.due = min(self.due, self._inhibited_until)
        self._has_event = True

    def request(self) -> bool:
        """Take a remote request; return whether it is answered."""
        if not self.is_active or not self._allows_remote:
            return False
        if self._is_event_driven:
            self.trigger()
            self._is_requested = True
            return True
        has_sample = self._sample is not None or self._must_sample
        is_sampled = self._type == SYNCHRONOUS_REMOTE and has_sample
        if self._type != EVENT_DRIVEN_REMOTE and not is_sampled:
            return False
        self._is_requested = True
        self.due = 0
        return True

    def synchronise(self, counter: int) -> None:
        """Take a SYNC with that counter; 0 where it has none."""
        if not self.is_active:
            return
        if self._type == SYNCHRONOUS_ACYCLIC:
            self.due = 0 if self._has_event else NEVER
        elif self._is_synchronous and (self._has_begun or self._begins_with(counter)):
            self._syncs += 1
            if self._syncs >= self._type:
                self._syncs = 0
                self.due = 0
        elif self._type == SYNCHRONOUS_REMOTE:
            self._must_sample = True
            self.due = 0

    def settle(self, now: int, emit: Emit) -> None:
        """Send what a SYNC has asked for, since the next one has come."""
        if self._follows_sync and now >= self.due:
            self.transmit(now, emit)

    def answer(self, now: int, emit: Emit) -> None:
        """Send what a remote request has asked for, since the next one has come."""
        if self._is_requested and now >= self.due:
            self.transmit(now, emit)

    def transmit(self, now: int, emit: Emit) -> None:
        """Send it with the present values; a type 252 with its sample, where it was asked for."""
        can_id: Any = self.can_id  # as the object that it is: nothing here computes with it
        if can_id is None or self._mapping is None:
            return
        self.due = NEVER
        self._has_event = False
        if self._is_synchronous and now > self._window.end:
            self._counters.late_synchronous_pdos += 1
            return
        if self._type == SYNCHRONOUS_REMOTE:
            data = self._sample_for_request(self._mapping)
        else:
            data = self._mapping.read()
        self._is_requested = False
        if data is not None:
            if self._seal is not None:
                data = self._seal.close(can_id, data)
            emit(make_frame(Frame, (can_id, data, False, False, 0, 0)))
        if self._is_event_driven:
            self._inhibited_until = now + self._inhibit_time
            if self._event_time:
                self.due = now + max(self._event_time, self._inhibit_time)

    def _sample_for_request(self, mapping: PdoMapping) -> bytes | None:
        """The sample of the last SYNC where it was asked for, else None; take it if SYNC came."""
        if self._must_sample:
            self._must_sample = False
            self._sample = mapping.read()
        return self._sample if self._is_requested else None

    def _begins_with(self, counter: int) -> bool:
        """Return True if the SYNC of that counter counts as the first; one without counter does."""
        self._has_begun = counter in {0, self._sync_start}
        return self._has_begun

    def _begin(self) -> None:
        self.is_active = (
            self._is_operational and self.can_id is not None and self._mapping is not None
        )
        self._has_event = False
        self._has_begun = not self._sync_start
        self._syncs = 0
        self._sample = None
        self._must_sample = False
        self._is_requested = False
        starts = self.is_active and self._is_event_driven
        self.due = self._inhibited_until if starts else NEVER


class TpdoProducer:
    """All transmit PDOs of a node, and before them the SYNC that this node itself produces.

    Attributes:
        due: when `transmit` has something to send [ns].
    """

    def __init__(
        self,
        object_dictionary: ObjectDictionary,
        window: SynchronousWindow,
        counters: NodeCounters,
    ) -> None:
        self.due = NEVER
        self._counters = counters
        self._sync: Frame | None = None
        self._settled: list[Frame] = []
        self._is_operational = False
        self._tpdos: dict[int, Tpdo] = {}
        self._active: tuple[Tpdo, ...] = ()
        for index in object_dictionary.indices(COMMUNICATION_INDICES[Direction.TPDO]):
            parameters = PdoParameters(object_dictionary, index, Direction.TPDO)
            tpdo = Tpdo(parameters, window, counters)
            self._tpdos[parameters.number] = tpdo
            parameters.add_hook(partial(self._configure, tpdo))

    @property
    def can_ids(self) -> frozenset[int]:
        """The identifiers in use."""
        return frozenset(tpdo.can_id for tpdo in self._tpdos.values() if tpdo.can_id is not None)

    def protect(self, number: int) -> bool:
        """Send TPDO `number` with a counter and a checksum; return whether there is one."""
        tpdo = self._tpdos.get(number)
        if tpdo is not None:
            tpdo.protect()
        return tpdo is not None

    def trigger(self, number: int) -> None:
        """Take an application event for TPDO `number`; without effect where there is none."""
        tpdo = self._tpdos.get(number)
        if tpdo is not None:
            tpdo.trigger()
            self.due = min(self.due, tpdo.due)

    def receive(self, frame: Frame, now: int) -> None:
        """Take a frame with the identifier of a TPDO: a remote request, or a stray."""
        if frame.is_remote and not frame.is_extended:
            asked = [tpdo for tpdo in self._tpdos.values() if tpdo.can_id == frame.can_id]
            for tpdo in asked:
                tpdo.answer(now, self._settled.append)
            self._counters.ignored_frames += not sum(tpdo.request() for tpdo in asked)
            self._find_due()
        else:
            self._counters.is_data(frame)

    def settle(self, now: int, emit: Emit | None = None) -> None:
        """Send what the last SYNC has asked for before the next one counts.

        Args:
            now: the time [ns].
            emit: where to; without it, the frames wait for `transmit`, which sends them first.
        """
        for tpdo in self._active:
            tpdo.settle(now, emit or self._settled.append)
        self._find_due()

    def synchronise(self, counter: int, sync: Frame | None = None) -> None:
        """Take a SYNC with that counter, 0 for none; `sync` is to be sent before the PDOs."""
        if sync is not None:
            self._sync, self.due = sync, 0
        for tpdo in self._active:
            tpdo.synchronise(counter)
            if tpdo.due < self.due:  # noqa: PLR1730 - min() costs more than all the rest here
                self.due = tpdo.due

    def transmit(self, now: int, emit: Emit) -> None:
        """Send the PDOs that are due, in the order of their numbers."""
        if now < self.due:
            return
        if self._settled:
            for frame in self._settled:
                emit(frame)
            self._settled.clear()
        if self._sync is not None:
            emit(self._sync)
            self._sync = None
        due = NEVER
        for tpdo in self._active:
            if now >= tpdo.due:
                tpdo.transmit(now, emit)
            if tpdo.due < due:  # noqa: PLR1730 - min() costs more than all the rest here
                due = tpdo.due
        self.due = due

    def set_operational(self, *, is_operational: bool) -> None:
        """Begin or end to transmit."""
        if is_operational is self._is_operational:
            return
        self._is_operational = is_operational
        for tpdo in self._tpdos.values():
            tpdo.set_operational(is_operational=is_operational)
        self._find_active()

    def reset(self) -> None:
        """Begin anew after the parameters got their defaults."""
        self._settled.clear()
        for tpdo in self._tpdos.values():
            tpdo.configure()
        self._find_active()

    def _configure(self, tpdo: Tpdo, _value: Any) -> None:  # noqa: ANN401 - it is a hook
        tpdo.configure()
        self._find_active()

    def _find_active(self) -> None:
        self._active = tuple(tpdo for tpdo in self._tpdos.values() if tpdo.is_active)
        self._find_due()

    def _find_due(self) -> None:
        due = min((tpdo.due for tpdo in self._active), default=NEVER)
        self.due = 0 if self._sync or self._settled else due
