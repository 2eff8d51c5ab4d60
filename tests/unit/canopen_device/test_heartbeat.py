def test_heartbeat_keeps_its_mean_period_when_rounds_do_not_divide_it(rig):
    rig.node.object_dictionary.download(0x1017, 0, (10).to_bytes(2, "little"))
    rig.run()  # the producer starts with a heartbeat
    start, times = rig.now, []
    for _ in range(100):
        times += [(rig.now - start) // 1_000_000 for frame in rig.run(3) if frame.can_id == 0x705]

    # Due at 10, 20, 30 ms ..., each sent in the first round of 3 ms at or after that.
    assert times == [-(-due // 3) * 3 for due in range(10, 301, 10)]


def test_missed_heartbeats_are_not_made_up_for(rig):
    rig.node.object_dictionary.download(0x1017, 0, (10).to_bytes(2, "little"))
    rig.run()
    assert len(rig.run(1000)) == 1
    assert rig.run(9) == []
    assert len(rig.run(1)) == 1


def test_watching_survives_the_change_of_another_entry(rig):
    dictionary = rig.node.object_dictionary
    dictionary.download(0x1016, 1, (7 << 16 | 10).to_bytes(4, "little"))
    rig.receive(0x707, b"\x05")
    rig.run(5)
    dictionary.download(0x1016, 2, (8 << 16 | 10).to_bytes(4, "little"))
    rig.run(5)
    assert rig.node.emcy.is_present(0x8130, source=7)


def test_unused_entry_frees_the_node(rig):
    dictionary = rig.node.object_dictionary
    entry = (7 << 16 | 10).to_bytes(4, "little")
    dictionary.download(0x1016, 1, entry)
    dictionary.download(0x1016, 1, bytes(4))
    dictionary.download(0x1016, 2, entry)
    assert 0x707 in rig.node.routes
