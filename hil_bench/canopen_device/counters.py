"""Counters of the frames and requests that a node ignored or refused."""

from dataclasses import dataclass

from hil_bench.canopen_device.frame import Frame


@dataclass(slots=True)
class NodeCounters:
    """Frames and values that had no effect, or less than their sender may have meant.

    Attributes:
        ignored_frames: remote frames that nothing answers, and 29-bit frames on one of our
            identifiers.
        malformed_nmt: NMT commands of a wrong length or with an unknown command.
        malformed_heartbeats: heartbeats of a wrong length or with an unknown state.
        malformed_time: TIME messages of a wrong length.
        unexpected_sync_length: SYNC messages with a counter that 0x1019 does not ask for, or
            without one that it does.
        short_rpdos: RPDOs with fewer bytes than mapped, not processed.
        long_rpdos: RPDOs with more bytes than mapped, processed.
        late_synchronous_pdos: synchronous PDOs after the end of the window 0x1007, discarded.
        refused_values: RPDO values outside an object's limits or refused by a check.
        sdo_aborts: SDO transfers that this node aborted.
        short_sdo_requests: SDO requests of fewer than 8 bytes, not answered.
        dropped_sdo_requests: SDO requests beyond the queue's length.
        malformed_lss: LSS messages of a wrong length, and those that switch to a reserved mode.
        dropped_lss_requests: LSS requests beyond the queue's length.
        dropped_emcy: emergency messages beyond the queue's length; the oldest go.
        foreign_frames: frames from elsewhere with an identifier that this node sends with; a second
            device has its node-ID. Who runs the node counts them.
    """

    ignored_frames: int = 0
    malformed_nmt: int = 0
    malformed_heartbeats: int = 0
    malformed_time: int = 0
    unexpected_sync_length: int = 0
    short_rpdos: int = 0
    long_rpdos: int = 0
    late_synchronous_pdos: int = 0
    refused_values: int = 0
    sdo_aborts: int = 0
    short_sdo_requests: int = 0
    dropped_sdo_requests: int = 0
    malformed_lss: int = 0
    dropped_lss_requests: int = 0
    dropped_emcy: int = 0
    foreign_frames: int = 0

    def is_data(self, frame: Frame) -> bool:
        """Return True if it is a data frame with an 11-bit identifier; count it where not."""
        if frame.is_remote or frame.is_extended:
            self.ignored_frames += 1
            return False
        return True
