"""The kinds of faults of sensors, valves, supplies and plants."""

from collections.abc import Mapping
from functools import partial
from types import MappingProxyType

from hil_bench.abilities.faults import effects
from hil_bench.abilities.faults.checks import BrokenReading, LeakPath, bounded, choose, to_ns
from hil_bench.abilities.faults.fault import Effect
from hil_bench.abilities.faults.kind import GROWTH, LARGEST, Site, amounts, fault_kind, percent
from hil_bench.abilities.faults.points import ENABLES, PLANTS, SENSORS, SUPPLIES, VALVES
from hil_bench.config.settings import Key
from hil_bench.config.values import choice, number
from hil_bench.devices.measurement.low_pass import normal_numbers
from hil_bench.errors import ConfigError
from hil_bench.plants.plant import SUPPLY
from hil_bench.units import BAR, LITRE_PER_MINUTE_BAR, MICROMETRE, MILLISECOND, NEWTON

# Of sensors, and the lag of sensors and spools.

_SHORTEST_LAG = 1e-6
_LONGEST_LAG = 1e6


@fault_kind(SENSORS)
def freeze(sensor: Site) -> Effect:
    """Freeze the value of a sensor."""
    return effects.SensorEffect(sensor.point(SENSORS), effects.Frozen)


@fault_kind(SENSORS, keys=amounts("offset", "amount"))
def offset(sensor: Site, amount: float) -> Effect:
    """Add an offset [Pa or m] to the value of a sensor."""
    make = partial(effects.Shifted, bounded("amount", amount), 0.0, sensor.tick)
    return effects.SensorEffect(sensor.point(SENSORS), make)


@fault_kind(SENSORS, keys=amounts("drift", "rate", rate=True))
def drift(sensor: Site, rate: float) -> Effect:
    """Let the value of a sensor drift at a rate [Pa/s or m/s]."""
    make = partial(effects.Shifted, 0.0, bounded("rate", rate), sensor.tick)
    return effects.SensorEffect(sensor.point(SENSORS), make)


@fault_kind(SENSORS, keys=amounts("noise", "rms", low=0.0))
def noise(sensor: Site, rms: float) -> Effect:
    """Add noise of an RMS [Pa or m] to the value of a sensor."""
    draw = normal_numbers(sensor.stream())
    make = partial(effects.Noisy, bounded("rms", rms, low=0.0), draw)
    return effects.SensorEffect(sensor.point(SENSORS), make)


@fault_kind(SENSORS, keys=(Key("reads", choice(BrokenReading), BrokenReading.NOTHING),))
def break_wire(sensor: Site, reads: BrokenReading | str = BrokenReading.NOTHING) -> Effect:
    """Break a sensor's wire: it reads "nothing", or beyond its range, "low" or "high"."""
    make = partial(effects.Broken, choose("reads", BrokenReading, reads))
    return effects.SensorEffect(sensor.point(SENSORS), make)


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
        return effects.SensorEffect(
            target.point(SENSORS), partial(effects.Slowed, lag, target.tick)
        )
    return effects.SpoolEffect(
        valve, lambda position: effects.Lag(lag, target.tick, position).follow
    )


# Of valve, cylinder and supply: what wears, breaks, leaks and falls off.
#
# Most may grow: from nothing, when they begin, to all of it after a time.

_HIGHEST_SUPPLY = 1e9  # [Pa], ten times that of a water jet cutter
_NO_UNIT = 'has no supply unit of its own; give it supply = "unit", or name the shared supply'


@fault_kind(VALVES)
def stick(valve: Site) -> Effect:
    """Hold the spool of a valve where it is."""
    return effects.SpoolEffect(valve.point(VALVES), lambda position: lambda _setpoint: position)


@fault_kind(VALVES)
def invert(valve: Site) -> Effect:
    """Invert the spool of a valve, as crossed wires do."""
    return effects.SpoolEffect(valve.point(VALVES), lambda _position: lambda setpoint: -setpoint)


@fault_kind(ENABLES)
def disable(valve: Site) -> Effect:
    """Switch the enable input of a valve off."""
    device = valve.point(ENABLES)

    def switch(_now: int, *, is_on: bool) -> None:
        device.enable_input = is_on

    return effects.Acts(partial(switch, is_on=False), partial(switch, is_on=True))


@fault_kind(
    SUPPLIES,
    keys=(Key("pressure_bar", number(BAR, low=-1.0, high=1e4), None, BAR, "pressure", "20"),),
    idle=None,
)
def drop_supply(axis: Site, pressure: float) -> Effect:
    """Hold the supply pressure of an axis at `pressure` [Pa], not below that of the tank.

    Raises:
        ConfigError: it is out of range, or not below what the supply has without the fault.
    """
    point = axis.point(SUPPLIES)
    bounded("pressure", pressure, low=point.held.low, high=_HIGHEST_SUPPLY)
    if pressure >= point.held.usual:
        usual = f"{BAR.from_si(point.held.usual):g} bar of the supply"
        wrong = f"{BAR.from_si(pressure):g} bar is not below the {usual}"
        raise ConfigError(f"faults: drop_supply {axis.name}: {wrong}; give less")
    holds = axis.places.holds

    def hold(_now: int) -> None:
        point.plant.influence(SUPPLY, pressure)

    def end(_now: int) -> None:
        holds.remove(hold)
        point.plant.influence(SUPPLY, None)

    return effects.Acts(lambda _now: holds.append(hold), end)


_LEAKS: Mapping[str, str] = MappingProxyType(
    {
        LeakPath.INTERNAL: "internal_leakage",
        LeakPath.A: "leakage_a",
        LeakPath.B: "leakage_b",
    }
)
_LEAK_KEYS = (
    Key(
        "leak_l_min_bar",
        number(LITRE_PER_MINUTE_BAR, low=0.0, high=5.0),
        None,
        LITRE_PER_MINUTE_BAR,
        "conductance",
        "0.05",
    ),
    Key("path", choice(LeakPath), LeakPath.INTERNAL),
    GROWTH,
)


@fault_kind(
    PLANTS,
    keys=_LEAK_KEYS,
    defects=_LEAKS,
    chosen_by="path",
    words={"leak_l_min_bar": "leakage", "path": "leaks at"},
)
def leak(
    axis: Site,
    conductance: float,
    path: LeakPath | str = LeakPath.INTERNAL,
    *,
    growth: float = 0.0,
) -> Effect:
    """Let oil leak: past the piston, or from chamber "a" or "b" to the tank.

    Args:
        axis: whose plant leaks.
        conductance: flow for each pressure [m³/(s Pa)].
        path: between what.
        growth: how long the leak takes to grow to that [s].
    """
    return wear(axis, conductance, growth, path=choose("path", LeakPath, path))


@fault_kind(
    PLANTS, keys=(percent("air_percent", "share", None, "2", 50.0), GROWTH), defects="entrained_air"
)
def aerate(axis: Site, share: float, *, growth: float = 0.0) -> Effect:
    """Let air into the oil: a share of the volume at atmospheric pressure."""
    return wear(axis, share, growth)


@fault_kind(
    PLANTS,
    keys=(
        Key(
            "opening_um",
            number(MICROMETRE, low=0.0, high=500.0),
            None,
            MICROMETRE,
            "opening",
            "20",
        ),
        GROWTH,
    ),
    defects="null_opening",
)
def wear_spool(axis: Site, opening: float, *, growth: float = 0.0) -> Effect:
    """Round the edges of the spool: the opening that leaks in the centre grows by this [m]."""
    return wear(axis, opening, growth)


@fault_kind(
    PLANTS,
    keys=(Key("force_n", number(NEWTON, low=0.0, high=1e9), None, NEWTON, "force", "5000"), GROWTH),
    defects="dry_friction",
)
def jam(axis: Site, force: float, *, growth: float = 0.0) -> Effect:
    """Add dry friction [N] to piston or load."""
    return wear(axis, force, growth)


_LOSS = (percent("loss_percent", "share", 100.0), GROWTH)


@fault_kind(
    PLANTS,
    keys=_LOSS,
    defects="load_loss",
    lacks="has no load to lose; give it load_n or load_mass_kg, a motor load_torque_n_m",
)
def drop_load(axis: Site, share: float = 1.0, *, growth: float = 0.0) -> Effect:
    """Remove a share of the loads, with their mass, from the rod."""
    return wear(axis, share, growth)


@fault_kind(PLANTS, keys=_LOSS, defects="pump_loss", lacks=_NO_UNIT)
def wear_pump(axis: Site, share: float = 1.0, *, growth: float = 0.0) -> Effect:
    """Let the pump of a supply unit lose a share of its flow."""
    return wear(axis, share, growth)


@fault_kind(
    PLANTS,
    keys=(Key("sag_bar", number(BAR, low=0.0, high=1e4), None, BAR, "pressure", "50"), GROWTH),
    defects="relief_sag",
    lacks=_NO_UNIT,
)
def sag_relief(axis: Site, pressure: float, *, growth: float = 0.0) -> Effect:
    """Let the relief valve of a supply unit open too early, by a pressure [Pa]."""
    return wear(axis, pressure, growth)


@fault_kind(PLANTS, keys=_LOSS, defects="gas_loss", lacks=_NO_UNIT)
def lose_gas(axis: Site, share: float = 1.0, *, growth: float = 0.0) -> Effect:
    """Let the accumulator of a supply unit lose a share of its gas."""
    return wear(axis, share, growth)


@fault_kind(
    PLANTS,
    keys=(percent("blocked_percent", "share", 100.0), GROWTH),
    defects="filter_clogging",
    lacks="has no filter of its own; give filter_rated_flow_l_min and filter_rated_drop_bar "
    "to its supply unit, or name the shared supply",
)
def clog_filter(axis: Site, share: float = 1.0, *, growth: float = 0.0) -> Effect:
    """Let dirt block a share of the element of a supply unit's filter."""
    return wear(axis, share, growth)


@fault_kind(VALVES, keys=(percent("band_percent", "band", None, "5"), GROWTH))
def bind(valve: Site, band: float, *, growth: float = 0.0) -> Effect:
    """Let the spool stick until its set-point differs by a share of the full opening."""
    point, ticks = valve.point(VALVES), grown(growth, valve)
    bounded("band", band, low=0.0, high=1.0)
    return effects.SpoolEffect(
        point,
        lambda position: effects.Bound(effects.Growth(band * point.full, ticks), position).follow,
    )


@fault_kind(VALVES, keys=(percent("travel_percent", "travel", None, "50"), GROWTH), idle=100.0)
def weaken(valve: Site, travel: float, *, growth: float = 0.0) -> Effect:
    """Let the solenoids move the spool by a share of the full opening only; 0 by none."""
    point, ticks = valve.point(VALVES), grown(growth, valve)
    bounded("travel", travel, low=0.0, high=1.0)
    return effects.SpoolEffect(
        point,
        lambda _position: effects.Weak(effects.Growth(1.0 - travel, ticks), point.full).follow,
    )


def wear(axis: Site, amount: float, growth: float = 0.0, **chosen: str) -> Effect:
    """Return the effect of a kind that makes a defect of a plant.

    Args:
        axis: the target.
        amount: of the defect, in SI.
        growth: how long it takes to grow to that [s].
        chosen: the value of the key that chooses one of several defects.

    Raises:
        ConfigError: the plant cannot have it.
    """
    point, kind = axis.point(PLANTS), axis.kind
    name = kind.defect(chosen)
    if name is None or name not in point.known:
        raise ConfigError(f"faults: {axis.lack(point.known)}")
    bounded(kind.name, amount, low=0.0, high=point.known[name].high)
    make = partial(effects.Growth, amount, grown(growth, axis))
    return effects.DefectEffect(point, name, make, axis.places.holds)


def grown(growth: float, site: Site) -> int:
    """Return a time of growth [s] in ticks of the bench."""
    return round(to_ns("growth", growth) * 1e-9 / site.tick)
