"""Which frames a scope marks; identifiers are those of CiA 301's predefined connection set."""

from hil_bench.abilities.panel.hub import FrameNews


def frame(identifier, data="", *, time=0.0, bus=0, extended=False, remote=False, fd=False):
    return [time, bus, "out", identifier, data, extended, remote, 4 * fd]


def test_emcy_and_nmt_are_news_and_process_data_is_not():
    frames = [frame(0x000, "0100"), frame(0x081, "00"), frame(0x181, "11"), frame(0x080)]
    assert FrameNews().take(frames) == frames[:2]


def test_a_heartbeat_is_news_where_its_state_is_another_one():
    news = FrameNews()
    assert news.take([frame(0x701, "7f"), frame(0x701, "7f")]) == []
    assert news.take([frame(0x701, "05")]) == [frame(0x701, "05")]
    assert news.take([frame(0x701, "05"), frame(0x702, "05"), frame(0x701, "7f", bus=1)]) == []


def test_frames_of_another_kind_are_no_news():
    assert (
        FrameNews().take(
            [frame(0x81, extended=True), frame(0x81, remote=True), frame(0x81, fd=True)]
        )
        == []
    )


def test_of_a_flood_the_newest_are_kept():
    frames = [frame(0x081, time=float(number)) for number in range(500)]
    found = FrameNews().take(frames)
    assert found == frames[-50:]
