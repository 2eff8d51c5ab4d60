"""What a node ignored or refused, counted."""

from dataclasses import dataclass


@dataclass(slots=True)
class NodeCounters:
    """Frames and values that had no effect, or less than their sender may have meant.

    Attributes:
        ignored_frames: remote frames, and 29-bit frames on one of our identifiers.
        malformed_nmt: NMT commands of a wrong length or with an unknown command.
        malformed_heartbeats: heartbeats of a wrong length or with an unknown state.
        unexpected_sync_length: SYNC messages with a counter that 0x1019 does not ask for, or
            without one that it does.
        short_rpdos: RPDOs with fewer bytes than mapped, not processed.
        long_rpdos: RPDOs with more bytes than mapped, processed.
        refused_values: RPDO values outside an object's limits or refused by a check.
        sdo_aborts: SDO transfers that this node aborted.
        short_sdo_requests: SDO requests of fewer than 8 bytes, not answered.
        dropped_sdo_requests: SDO requests beyond the queue's length.
        dropped_emcy: emergency messages beyond the queue's length; the oldest go.
    """

    ignored_frames: int = 0
    malformed_nmt: int = 0
    malformed_heartbeats: int = 0
    unexpected_sync_length: int = 0
    short_rpdos: int = 0
    long_rpdos: int = 0
    refused_values: int = 0
    sdo_aborts: int = 0
    short_sdo_requests: int = 0
    dropped_sdo_requests: int = 0
    dropped_emcy: int = 0
