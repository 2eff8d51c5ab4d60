from hil_bench.canopen_device.frame import Frame, make_frame


def test_the_quick_way_makes_the_same_frame():
    frame = make_frame(Frame, (0x705, b"", True, False, 3, 0))
    assert isinstance(frame, Frame)
    assert frame == Frame(0x705, is_remote=True, bus=3)
