"""An encoder on the rig of the device tests: fitted, moved, and read."""

from hil_bench.devices.encoder_406 import EncoderDevice


def fit_encoder(rig):
    rig.device = EncoderDevice(rig.node)
    move(rig, 0.0)
    return rig


def move(rig, position, speed=0.0):
    """Let the encoder see this position [m] and speed [m/s] from now on, and run one tick."""
    rig.work = lambda now: rig.device.publish(position, speed, now)
    rig.tick()


def position(rig):
    assert rig.value(0x6004) == rig.value(0x6020, 1)
    return rig.value(0x6004)
