"""The kinds of faults of sensors, and the lag of sensors and spools."""

from functools import partial

from hil_bench.abilities.faults.checks import bounded, choose
from hil_bench.abilities.faults.effects import SensorEffect, SpoolEffect
from hil_bench.abilities.faults.fault import Effect
from hil_bench.abilities.faults.kind import LARGEST, Site, amounts, fault_kind
from hil_bench.abilities.faults.points import SENSORS, VALVES
from hil_bench.abilities.faults.sensor_stages import Broken, Frozen, Lag, Noisy, Shifted, Slowed
from hil_bench.abilities.faults.words import BrokenReading
from hil_bench.config.settings import Key
from hil_bench.config.values import choice, number
from hil_bench.devices.measurement.low_pass import normal_numbers
from hil_bench.units import MILLISECOND

_SHORTEST_LAG = 1e-6
_LONGEST_LAG = 1e6


@fault_kind(SENSORS)
def freeze(sensor: Site) -> Effect:
    """Freeze the value of a sensor."""
    return SensorEffect(sensor.point(SENSORS), Frozen)


@fault_kind(SENSORS, keys=amounts("offset", "amount"))
def offset(sensor: Site, amount: float) -> Effect:
    """Add an offset [Pa or m] to the value of a sensor."""
    make = partial(Shifted, bounded("amount", amount), 0.0, sensor.tick)
    return SensorEffect(sensor.point(SENSORS), make)


@fault_kind(SENSORS, keys=amounts("drift", "rate", rate=True))
def drift(sensor: Site, rate: float) -> Effect:
    """Let the value of a sensor drift at a rate [Pa/s or m/s]."""
    make = partial(Shifted, 0.0, bounded("rate", rate), sensor.tick)
    return SensorEffect(sensor.point(SENSORS), make)


@fault_kind(SENSORS, keys=amounts("noise", "rms", low=0.0))
def noise(sensor: Site, rms: float) -> Effect:
    """Add noise of an RMS [Pa or m] to the value of a sensor."""
    draw = normal_numbers(sensor.stream())
    make = partial(Noisy, bounded("rms", rms, low=0.0), draw)
    return SensorEffect(sensor.point(SENSORS), make)


@fault_kind(SENSORS, keys=(Key("reads", choice(BrokenReading), BrokenReading.NOTHING),))
def break_wire(sensor: Site, reads: BrokenReading | str = BrokenReading.NOTHING) -> Effect:
    """Break a sensor's wire: it reads "nothing", or beyond its range, "low" or "high"."""
    make = partial(Broken, choose("reads", BrokenReading, reads))
    return SensorEffect(sensor.point(SENSORS), make)


_TIME_CONSTANT = Key(
    "time_constant_ms",
    number(MILLISECOND, low=1e-3, high=LARGEST),
    None,
    MILLISECOND,
    "time_constant",
    "100",
)


@fault_kind(SENSORS, VALVES, keys=(_TIME_CONSTANT,), idle=None)
def slow(target: Site, time_constant: float) -> Effect:
    """Add a lag of a time constant [s] to a sensor, or to the spool of a valve."""
    lag = bounded("time_constant", time_constant, low=_SHORTEST_LAG, high=_LONGEST_LAG)
    valve = target.points.of(VALVES).get(target.name)
    if valve is None:
        return SensorEffect(target.point(SENSORS), partial(Slowed, lag, target.tick))
    return SpoolEffect(valve, lambda position: Lag(lag, target.tick, position).follow)
