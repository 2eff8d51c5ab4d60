"""The bus itself: frames pass between independent programs, before any of ours is on it."""

import subprocess

import can
from support.patience import GUARD


def test_python_can_hears_what_can_utils_sends(channel):
    with can.Bus(interface="socketcan", channel=channel) as bus:
        subprocess.run(["cansend", channel, "123#DEADBEEF"], check=True)
        message = bus.recv(timeout=GUARD)
    assert message is not None
    assert (message.arbitration_id, bytes(message.data)) == (0x123, b"\xde\xad\xbe\xef")


def test_candump_sees_what_python_can_sends(channel):
    with (
        can.Bus(interface="socketcan", channel=channel) as bus,
        subprocess.Popen(
            ["candump", "-L", "-n", "1", f"{channel},124:7FF"], stdout=subprocess.PIPE, text=True
        ) as candump,
    ):
        # candump says nothing when it starts to listen, so the frame is repeated until it ends.
        task = bus.send_periodic(can.Message(arbitration_id=0x124, is_extended_id=False), 0.05)
        output, _ = candump.communicate(timeout=GUARD)
        task.stop()
    assert output.split()[1:] == [channel, "124#"]
