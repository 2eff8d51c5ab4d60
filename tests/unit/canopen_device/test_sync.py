"""SYNC in rounds that do not fit it; the services themselves are in tests/transcripts."""

MICROSECONDS_10_000 = (10_000).to_bytes(4, "little")
PRODUCER = (0x40000080).to_bytes(4, "little")


def sync_times(rig, rounds, milliseconds):
    """Run and return when SYNC came [ms]."""
    start, times = rig.now, []
    for _ in range(rounds):
        frames = rig.run(milliseconds)
        times += [(rig.now - start) // 1_000_000 for frame in frames if frame.can_id == 0x080]
    return times


def produce(rig):
    rig.node.object_dictionary.download(0x1006, 0, MICROSECONDS_10_000)
    rig.node.object_dictionary.download(0x1005, 0, PRODUCER)
    rig.run()  # the first SYNC


def test_sync_keeps_its_mean_period_when_rounds_do_not_divide_it(rig):
    produce(rig)
    # Due at 10, 20, 30 ms ..., each sent in the first round of 3 ms at or after that.
    assert sync_times(rig, 100, 3) == [-(-due // 3) * 3 for due in range(10, 301, 10)]


def test_missed_syncs_are_not_made_up_for(rig):
    produce(rig)
    assert sync_times(rig, 1, 1000) == [1000]
    assert sync_times(rig, 20, 1) == [10, 20]


def test_a_synchronous_tpdo_after_the_window_is_discarded(rig):
    dictionary = rig.node.object_dictionary
    dictionary.download(0x1007, 0, (2000).to_bytes(4, "little"))
    dictionary.download(0x1801, 2, b"\x01")
    rig.receive(0x000, b"\x01\x05")
    rig.run()
    rig.receive(0x080, b"")
    assert [frame.can_id for frame in rig.run(2)] == [0x285]  # at the very end of the window
    rig.receive(0x080, b"")
    assert rig.run(3) == []
    assert rig.node.counters.late_synchronous_pdos == 1
