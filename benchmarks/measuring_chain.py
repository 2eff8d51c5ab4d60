"""Cost of a measuring chain per sample, beside scipy.signal, and a picture of what it does.

    python benchmarks/measuring_chain.py [--samples N] [--repeats N] [--plot FILE]

A sample is one call a tick, as the bench makes it. The peer is the low-pass alone as
`scipy.signal.lfilter` and `sosfilt` do it, called sample by sample with their state kept: what a
bench would do that takes its filters from a library. All are measured in turn.
"""

import argparse
import math
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy
from scipy import signal

import occasion
from hil_bench.abilities.common.figure_style import BLUE, GREEN, GREY, ORANGE, RED, STYLE
from hil_bench.devices.kinds.bindings import PositionPreset, PressurePreset, preset_chain
from hil_bench.devices.measurement.chain import MeasuringChain
from hil_bench.devices.measurement.low_pass import ChainParameters, random_stream

TICK_NS = 1_000_000
BAR = 1e5
EVERYTHING = {
    "hysteresis": 0.25 * BAR,
    "offset_error": 0.25 * BAR,
    "gain_error": 1e-3,
    "offset_drift": 0.02 * BAR,
    "gain_drift": 80e-6,
    "temperature": ((0.0, 0.0), (3600.0, 40.0)),
    "bandwidth": 233.0,
    "order": 2,
    "sampling_period_ns": 1_000_000,
    "noise_density": 100.0,
    "noise_rms": 0.04 * BAR,
    "resolution": 0.004 * BAR,
    "range": (-12.5 * BAR, 275.0 * BAR),
    "delay_ns": 500_000,
}
ALONE = {
    "hysteresis": ("hysteresis",),
    "offset and gain error": ("offset_error", "gain_error"),
    "those with temperature drift": (
        "offset_error", "gain_error", "offset_drift", "gain_drift", "temperature",
    ),
    "bandwidth, second order": ("bandwidth", "order"),
    "sampling of its own": ("sampling_period_ns",),
    "noise, RMS": ("noise_rms",),
    "noise, density, with its bandwidth": ("bandwidth", "order", "noise_density"),
    "quantisation": ("resolution",),
    "range": ("range",),
    "transport delay": ("delay_ns",),
}  # fmt: skip

Measure = Callable[[float], object]


def make_chain(**parameters: object) -> MeasuringChain:
    """Return a chain with a stream of its own."""
    return MeasuringChain(ChainParameters(**parameters), TICK_NS, random_stream(1, "sensor"))


def discrete_low_pass() -> tuple[np.ndarray, np.ndarray]:
    """Return the second-order low-pass of `EVERYTHING`, matched for a first-order hold."""
    zeta = 0.7
    skew = 1.0 - 2.0 * zeta**2
    omega = 2.0 * math.pi * 233.0 / math.sqrt(skew + math.hypot(1.0, skew))
    system = ([omega**2], [1.0, 2.0 * zeta * omega, omega**2])
    numerator, denominator, _ = signal.cont2discrete(system, TICK_NS * 1e-9, method="foh")
    return numerator.ravel(), denominator


def lfilter_peer() -> Measure:
    """Return the low-pass by `lfilter`, one sample a call."""
    numerator, denominator = discrete_low_pass()
    state = signal.lfilter_zi(numerator, denominator) * 0.0

    def measure(sample: float) -> object:
        nonlocal state
        output, state = signal.lfilter(numerator, denominator, [sample], zi=state)
        return output[0]

    return measure


def sosfilt_peer() -> Measure:
    """Return the low-pass by `sosfilt`, one sample a call."""
    sections = signal.tf2sos(*discrete_low_pass())
    state = signal.sosfilt_zi(sections) * 0.0

    def measure(sample: float) -> object:
        nonlocal state
        output, state = signal.sosfilt(sections, [sample], zi=state)
        return output[0]

    return measure


def ns_per_sample(measure: Measure, samples: list[float]) -> float:
    """Return the cost of one call [ns]."""
    start = time.perf_counter_ns()
    for sample in samples:
        measure(sample)
    return (time.perf_counter_ns() - start) / len(samples)


def print_costs(count: int, repeats: int) -> None:
    """Print the medians as a Markdown table."""
    samples = [100.0 * BAR + 1e3 * (number % 700) for number in range(count)]
    variants: dict[str, Measure] = {"everything on": make_chain(**EVERYTHING).measure}
    for name, keys in ALONE.items():
        chain = make_chain(**{key: EVERYTHING[key] for key in keys})
        variants[f"alone: {name}"] = chain.measure
    variants["the low-pass alone, `scipy.signal.lfilter`"] = lfilter_peer()
    variants["the low-pass alone, `scipy.signal.sosfilt`"] = sosfilt_peer()
    costs: dict[str, list[float]] = {name: [] for name in variants}
    for _ in range(repeats):
        for name, measure in variants.items():
            costs[name].append(ns_per_sample(measure, samples))
    medians = {name: statistics.median(values) for name, values in costs.items()}
    whole = medians["everything on"]
    versions = f"Python {platform.python_version()}, SciPy {scipy.__version__}"
    print(f"{platform.machine()}, {versions}, medians of {repeats} times {count} samples\n")
    print("| chain | ns per sample | ratio to everything on |\n|---|---|---|")
    for name, cost in medians.items():
        print(f"| {name} | {cost:.0f} | {cost / whole:.2f} |")


def run_chain(chain: MeasuringChain, quantity: np.ndarray) -> np.ndarray:
    """Return the output of a chain for a quantity, tick by tick."""
    return np.array([chain.measure(float(value)) for value in quantity])


def plot(path: Path) -> None:
    """Draw a step, slow motion and noise through the presets."""
    import matplotlib as mpl  # noqa: PLC0415 - for the picture only
    from matplotlib.figure import Figure  # noqa: PLC0415

    pressure = preset_chain("Pa", PressurePreset.CLASS_025_250_BAR)
    position = preset_chain("m", PositionPreset.MAGNETOSTRICTIVE_1_UM)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(10, 7), layout="constrained")
        (step, loop), (noise, spectrum) = figure.subplots(2, 2)
        draw_step(step, pressure)
        draw_motion(loop, position)
        draw_noise(noise, pressure)
        draw_spectrum(spectrum)
        figure.savefig(path, dpi=110)


def draw_step(axes, pressure: ChainParameters) -> None:  # noqa: ANN001 - matplotlib's
    """Draw a pressure step through the transducer, and through a second-order low-pass."""
    fine_ns = 50_000
    count = 300
    time_ms = (np.arange(count) * fine_ns - 2_000_000) * 1e-6
    quantity = np.where(time_ms < 0, 50.0, 150.0) * BAR
    stream = random_stream(1, "pressure_a")
    lines = {
        "pressure": (quantity, GREY),
        "class 0.25, 250 bar": (
            run_chain(MeasuringChain(pressure, fine_ns, stream), quantity),
            BLUE,
        ),
        "100 Hz, second order,\n2 ms delay": (
            run_chain(
                MeasuringChain(
                    ChainParameters(
                        bandwidth=100.0, order=2, damping_ratio=0.5, delay_ns=2_000_000
                    ),
                    fine_ns,
                    stream,
                ),
                quantity,
            ),
            ORANGE,
        ),
    }
    for label, (values, colour) in lines.items():
        axes.step(time_ms, values / BAR, where="post", label=label, color=colour)
    axes.set(title="A step", xlabel="Time [ms]", ylabel="Pressure [bar]")
    axes.legend(loc="center right")


def draw_motion(axes, position: ChainParameters) -> None:  # noqa: ANN001 - matplotlib's
    """Draw a slow motion to and fro through the position sensor."""
    ticks = np.arange(400)
    quantity = 15e-6 * np.sin(2 * math.pi * ticks / 400)
    values = run_chain(MeasuringChain(position, TICK_NS, random_stream(1, "position")), quantity)
    clean = ChainParameters(hysteresis=4e-6, resolution=1e-6)
    loop = run_chain(MeasuringChain(clean, TICK_NS, random_stream(1, "position")), quantity)
    axes.plot(quantity * 1e6, quantity * 1e6, color=GREY, label="position")
    axes.plot(quantity * 1e6, values * 1e6, ".", color=BLUE, ms=3, label="magnetostrictive, 1 um")
    axes.step(quantity * 1e6, loop * 1e6, color=RED, lw=1, label="its hysteresis and resolution")
    axes.set(title="To and fro", xlabel="Position [um]", ylabel="Shown [um]")
    axes.legend()


def draw_noise(axes, pressure: ChainParameters) -> None:  # noqa: ANN001 - matplotlib's
    """Draw a pressure at rest as the transducer shows it."""
    quantity = np.full(300, 100.0 * BAR)
    values = run_chain(MeasuringChain(pressure, TICK_NS, random_stream(1, "pressure_a")), quantity)
    axes.axhline(100.0, color=GREY, label="pressure")
    axes.axhline(100.35, color=GREEN, ls="--", label="with offset and gain error")
    axes.step(np.arange(300), values / BAR, where="post", color=BLUE, lw=1, label="shown")
    axes.set(title="At rest, class 0.25", xlabel="Time [ms]", ylabel="Pressure [bar]")
    axes.legend()


def draw_spectrum(axes) -> None:  # noqa: ANN001 - matplotlib's
    """Draw the spectrum of noise of a given density, beside theory."""
    density, bandwidth, rate = 100.0, 100.0, 2000.0
    parameters = ChainParameters(noise_density=density, bandwidth=bandwidth)
    chain = MeasuringChain(parameters, round(1e9 / rate), random_stream(1, "pressure_a"))
    values = run_chain(chain, np.zeros(200_000))
    frequency, power = signal.welch(values, rate, nperseg=2000)
    theory = density / np.sqrt(1.0 + (frequency / bandwidth) ** 2)
    axes.loglog(frequency[1:], np.sqrt(power[1:]), color=BLUE, label="shown")
    axes.loglog(frequency[1:], theory[1:], color=ORANGE, label="density times gain of the low-pass")
    axes.set(
        title="Noise of 100 Pa/√Hz, 100 Hz, first order",
        xlabel="Frequency [Hz]",
        ylabel="Density [Pa/√Hz]",
    )
    axes.legend()


def main() -> None:
    """Print the costs, and draw the picture if asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=20_000)
    parser.add_argument("--repeats", type=int, default=15)
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the picture, and no table")
    args = occasion.arguments(parser, samples=100, repeats=2)
    if args.plot:
        plot(args.plot)
    else:
        print_costs(args.samples, args.repeats)


if __name__ == "__main__":
    main()
