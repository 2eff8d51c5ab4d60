"""A valve on the rig of the device tests: fitted, commanded as a controller does it, and read."""

from hil_bench.devices.valve_408 import ValveDevice

FULL_OPENING = 1e-3
INIT, DISABLED, HOLD, ACTIVE, FAULT_HOLD = 0x0008, 0x0009, 0x000B, 0x000F, 0x0003


def fit_valve(rig):
    """Put a valve on the rig whose spool is where it is told to be."""
    rig.valve = ValveDevice(rig.node, FULL_OPENING)

    def work(now):
        rig.spool = rig.valve.command(now)
        rig.valve.publish(rig.spool, now)

    rig.work = work
    rig.tick()
    return rig


def activate(rig, setpoint=0):
    """Have the valve follow the bus."""
    rig.nmt(rig.START)
    control(rig, 0x0007, setpoint)
    return rig


def control(rig, word, setpoint=0):
    """Send RPDO1, as the controller does, and run the tick that takes it."""
    rig.receive(0x205, *word.to_bytes(2, "little"), *setpoint.to_bytes(2, "little", signed=True))
    rig.tick()


def status(rig):
    return rig.value(0x6041)


def demand(rig, setpoint):
    """Command a set-point, and return the demand value that it leads to."""
    control(rig, 0x0007, setpoint)
    return rig.value(0x6310, 1)


def set_up(rig, **values):
    """Write `x6330=1` and the like: to sub-index 1 where the object has one."""
    for name, value in values.items():
        index = int(name[1:], 16)
        variable = rig.object_dictionary.find(index, 1) or rig.object_dictionary.find(index)
        size = variable.data_type.size
        assert rig.write(index, variable.subindex, value, size, signed=value < 0) is None
