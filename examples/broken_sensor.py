"""Shows what a position controller does while sensors, valve and supply break, one by one.

    python examples/broken_sensor.py
    python examples/broken_sensor.py --plot broken_sensor.png

Bench and controller are in this process, in virtual time: each run gives the same numbers. The
sensors are real ones (docs/measuring-chain.md), the faults are those of docs/faults.md.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from hil_bench import Faults, VirtualBench, load_config
from hil_bench.outside.recording.channels import Recording
from hil_drivers import (
    MotionProfile,
    Network,
    PositionLoop,
    PositionSensor,
    PressureSensor,
    ProportionalValve,
)

CONFIG = Path(__file__).with_name("real_sensors.toml")
DURATION = 9.0  # of the motion [s]
STEPS = (
    (1.0, 1.5, "position\noffset 5 mm"),
    (2.5, 2.8, "position\nfrozen"),
    (4.0, 4.5, "spool\nsluggish"),
    (5.5, 6.0, "supply\n25 bar"),
    (7.0, 8.5, "wire of P_A\nbroken"),
)


def schedule(faults: Faults, start: float) -> None:
    """Let the faults of `STEPS` happen, counted from `start` [s]."""
    when = [{"at": start + begin, "duration": end - begin} for begin, end, _ in STEPS]
    faults.offset("position", 0.005, **when[0])
    faults.freeze("position", **when[1])
    faults.slow("valve", 0.05, **when[2])
    faults.drop_supply("axis1", 25e5, **when[3])
    faults.break_wire("pressure_a", **when[4])


def control() -> tuple[float, np.ndarray, Recording]:
    """Return start of the motion [s], the controller's cycles, and what the bench recorded.

    A cycle is its time and the set-point [m].
    """
    with (
        VirtualBench(load_config(CONFIG)) as bench,
        Network(bench.bus, clock=bench.now) as network,
        ProportionalValve(network, node_id=1) as valve,
    ):
        network.pump(0.001)  # the devices boot: what comes earlier is lost
        position = PositionSensor(network, node_id=4)
        pressures = (PressureSensor(network, node_id=2), PressureSensor(network, node_id=3))
        for node_id, device in enumerate((valve, *pressures, position), 1):
            device.setup()
            network.start_node(node_id)
        loop = PositionLoop(network, valve=valve, position=position, pressures=pressures)
        profile = MotionProfile(
            loop.sample(), [0.05, -0.05], speed=0.1, acceleration=1.0, dwell=0.3, repeat=True
        )
        valve.enable()
        start = network.now()
        schedule(bench.faults, start)
        cycles = [(cycle.time, cycle.position_setpoint) for cycle in loop.run(profile, DURATION)]
        return start, np.array(cycles), bench.signals


def tracking_errors(start: float, cycles: np.ndarray, signals: Recording) -> dict[str, float]:
    """Return the largest true position error [m] without a fault, and during each."""
    times = signals["time"] - start
    error = np.abs(signals["axis1.position"] - np.interp(times, *cycles.T))
    spans = {"before the first": (0.5, STEPS[0][0])}
    spans |= {name.replace("\n", " "): (begin, end) for begin, end, name in STEPS}
    return {
        name: float(error[(times >= begin) & (times < end)].max())
        for name, (begin, end) in spans.items()
    }


def plot(start: float, cycles: np.ndarray, signals: Recording, path: Path) -> None:
    """Draw what was measured beside what was true."""
    import matplotlib as mpl  # noqa: PLC0415 - only here
    from matplotlib.figure import Figure  # noqa: PLC0415

    from hil_bench.abilities.common.figure_style import BLUE, GREY, ORANGE, STYLE  # noqa: PLC0415

    times = signals["time"] - start

    def shade(axes: Any) -> None:  # noqa: ANN401 - matplotlib brings no types
        for begin, end, _ in STEPS:
            axes.axvspan(begin, end, color=ORANGE, alpha=0.15, lw=0)

    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(10, 8.5), layout="constrained")
        top, middle, bottom, last = figure.subplots(4, 1, sharex=True)
        below = {"color": GREY, "lw": 2.6}  # wide, or what lies on it would hide it
        top.plot(times, signals["axis1.position"] * 1e3, label="true", **below)
        top.plot(times, signals["position.measured"] * 1e3, color=BLUE, lw=1.3, label="measured")
        top.plot(cycles[:, 0], cycles[:, 1] * 1e3, "k--", lw=1, label="set-point")
        top.set(ylabel="Position [mm]", ylim=(-150.0, 70.0))  # room for the names of the faults
        error = signals["axis1.position"] - np.interp(times, *cycles.T)
        middle.plot(times, error * 1e3, color=BLUE)
        middle.set_ylabel("True error [mm]")
        setpoint, spool = (
            signals[f"axis1.spool_{what}"] * 1e2 for what in ("setpoint", "position")
        )
        bottom.plot(times, setpoint, "--", label="set-point", **below)
        bottom.plot(times, spool, color=BLUE, lw=1.3, label="actual")
        bottom.set_ylabel("Spool [%]")
        last.plot(times, signals["axis1.P_A"] / 1e5, label="$P_A$ true", **below)
        last.plot(times, signals["pressure_a.measured"] / 1e5, color=BLUE, lw=1.3, label="measured")
        last.set(ylabel="Pressure [bar]", xlabel="Time [s]", xlim=(0.0, DURATION))
        for axes in (top, middle, bottom, last):
            shade(axes)
        for axes in (top, bottom, last):
            axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.0)
        for begin, end, name in STEPS:
            top.text((begin + end) / 2, -146.0, name, ha="center", va="bottom", size=8)
        figure.align_ylabels()
        figure.savefig(path, dpi=110)


def main() -> None:
    """Run the controller, and print how far it was off."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw what happened")
    args = parser.parse_args()
    start, cycles, signals = control()
    for name, error in tracking_errors(start, cycles, signals).items():
        print(f"{name:24} {error * 1e3:6.2f} mm off at most")
    if args.plot:
        plot(start, cycles, signals, args.plot)


if __name__ == "__main__":
    main()
