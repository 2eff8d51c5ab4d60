"""Sensors and a logger for `strange_plant`: strokes as CSV, and the map of their columns.

Four strokes each way at each of three amplitudes, a file an amplitude. The sensors have ranges,
steps, noise, lags and offsets, which change from file to file; the logger has a period, jitter, and
loses rows. Strokes at other amplitudes are kept apart, as they were, for whoever predicts them.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter
from support.strange_machines import Stranger
from support.strange_plant import ROW, Run, rest_state, run_stroke

FITTED = (0.25, 0.45, 0.7)
APART = (0.35, 0.58, 0.85)
STROKES = 4


@dataclass(frozen=True, kw_only=True)
class Logger:
    """What lies between a machine and a file; lags in s, steps and noise in SI units."""

    period: float
    jitter: float  # of a period
    lost: float  # share of rows
    units: str  # "plain", "volts", "counts"
    comma: bool
    pressures: tuple[str, ...]
    position_step: float
    position_noise: float
    position_lag: float
    position_offset: float
    pressure_step: float
    pressure_noise: float
    pressure_lag: float
    pressure_offsets: tuple[tuple[float, float], ...]  # a pair a file
    pressure_range: float
    inverted: bool


class Kept(NamedTuple):
    """A stroke that is kept apart: its amplitude, and what it was."""

    amplitude: float
    run: Run


class Records(NamedTuple):
    """Files of a machine, and the strokes kept apart."""

    files: list[Path]
    columns: Path
    kept: list[Kept]


def draw_logger(seed: int, stranger: Stranger) -> Logger:
    """Draw the sensors and the logger of a machine."""
    rng = np.random.default_rng([seed, stranger.number, 1])
    top = 250e5 if stranger.machine.supply < 200e5 else 400e5
    noise = rng.uniform(0.02e5, 0.25e5)
    pressures = [("P_A", "P_B"), ("P_A", "P_B"), ("P_A",), ("P_B",)][rng.integers(4)]
    return Logger(
        period=float(rng.choice([1e-3, 2e-3, 2e-3, 4e-3])),
        jitter=float(rng.choice([0.0, 0.05, 0.2])),
        lost=float(rng.choice([0.0, 0.0, 0.003])),
        units=str(rng.choice(["plain", "volts", "counts"])),
        comma=bool(rng.random() < 0.3),
        pressures=pressures,
        position_step=stranger.machine.stroke * 1.2 / 2.0 ** int(rng.choice([12, 14, 16])),
        position_noise=rng.uniform(3e-6, 40e-6),
        position_lag=float(rng.choice([0.0, 1e-3, 3e-3])),
        position_offset=rng.uniform(-1e-3, 1e-3),
        pressure_step=top / 2.0 ** int(rng.choice([12, 14, 16])),
        pressure_noise=noise,
        pressure_lag=float(rng.choice([0.0, 1e-3, 2e-3, 5e-3])),
        pressure_offsets=tuple(tuple(rng.uniform(-0.3e5, 0.3e5, 2)) for _ in FITTED),
        pressure_range=top,
        inverted=False,
    )


def run_machine(stranger: Stranger, amplitudes=FITTED, strokes: int = STROKES) -> list[list[Run]]:
    """All strokes of a machine, a list an amplitude, and the last list for those kept apart."""
    machine = stranger.machine
    limit = None if stranger.into_stop else 0.8 * machine.half
    state = rest_state(machine, -(limit or 0.99 * machine.half))
    plans = [[way * one for _ in range(strokes) for way in (1, -1)] for one in amplitudes]
    plans.append([way * one for one in APART for way in (1, -1)])
    count, done, sessions = sum(map(len, plans)), 0, []
    for plan in plans:
        runs = []
        for amplitude in plan:
            warm = stranger.cool + stranger.warming * done / count
            runs.append(run_stroke(machine, state, amplitude, temperature=warm, limit=limit))
            state, done = runs[-1].end, done + 1
        sessions.append(runs)
    return sessions


def write_records(
    stranger: Stranger,
    logger: Logger,
    folder: Path,
    seed: int,
    strokes: int = STROKES,
    take: int = 2,
) -> Records:
    """Run a machine and write what its logger writes of it.

    Args:
        stranger: the machine.
        logger: its sensors and logger.
        folder: for the files.
        seed: of the noise.
        strokes: each way at each amplitude.
        take: another one has other noise.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng([seed, stranger.number, take])
    *fitted, apart = run_machine(stranger, strokes=strokes)
    files = []
    for number, (amplitude, runs) in enumerate(zip(FITTED, fitted, strict=True)):
        path = folder / f"strokes_{100 * amplitude:.0f}.csv"
        _write(path, joined(runs), stranger, logger, rng, logger.pressure_offsets[number])
        files.append(path)
    columns = folder / "rig.toml"
    columns.write_text(column_map(logger, stranger), encoding="utf-8")
    kept = [
        Kept(way * one, run)
        for (one, way), run in zip([(o, w) for o in APART for w in (1, -1)], apart, strict=True)
    ]
    return Records(files, columns, kept)


def write_record(
    stranger: Stranger, logger: Logger, folder: Path, seed: int, strokes: int, take: int
) -> Path:
    """Write the strokes at all amplitudes as one file; arguments as of `write_records`."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng([seed, stranger.number, take])
    runs = [run for part in run_machine(stranger, strokes=strokes)[:-1] for run in part]
    path = folder / "strokes.csv"
    _write(path, joined(runs), stranger, logger, rng, logger.pressure_offsets[0])
    (folder / "rig.toml").write_text(column_map(logger, stranger), encoding="utf-8")
    return path


def joined(runs: list[Run]) -> dict[str, np.ndarray]:
    """Strokes one after the other, in rows of `ROW`."""
    names = ("command", "x", "pressure_a", "pressure_b")
    rows = {name: np.concatenate([getattr(run, name) for run in runs]) for name in names}
    rows["time"] = ROW * np.arange(len(rows["x"]))
    return rows


def _lagged(values: np.ndarray, lag: float) -> np.ndarray:
    if not lag:
        return values
    share = 1.0 - np.exp(-ROW / lag)
    shown, _ = lfilter([share], [1.0, share - 1.0], values, zi=[(1.0 - share) * values[0]])
    return shown


def seen_by(rows, logger: Logger, offsets, rng) -> dict[str, np.ndarray]:
    """The rows that the logger keeps, in SI units, with all that sensors do to them."""
    count = int(rows["time"][-1] / logger.period)
    times = logger.period * np.arange(count)
    times = np.clip(times + logger.period * logger.jitter * rng.standard_normal(count), 0.0, None)
    times = np.sort(times)
    times = times[rng.random(count) >= logger.lost]
    count = len(times)
    shown = {"time": np.round(times, 6)}
    last = np.searchsorted(rows["time"], times, side="right") - 1
    shown["command"] = rows["command"][last]
    place = np.interp(times, rows["time"], _lagged(rows["x"], logger.position_lag))
    place += logger.position_noise * rng.standard_normal(count)
    shown["position"] = logger.position_step * np.rint(place / logger.position_step)
    for name, offset in zip(("P_A", "P_B"), offsets, strict=True):
        true = rows["pressure_a" if name == "P_A" else "pressure_b"]
        value = np.interp(times, rows["time"], _lagged(true, logger.pressure_lag)) + offset
        value += logger.pressure_noise * rng.standard_normal(count)
        value = np.clip(value, 0.0, logger.pressure_range)
        shown[name] = logger.pressure_step * np.rint(value / logger.pressure_step)
    return shown


def _scales(logger: Logger, stranger: Stranger):
    """Raw units: name, unit, gain and offset of each column in mm, bar and volts or percent."""
    reach, top = 1e3 * stranger.machine.stroke, logger.pressure_range / 1e5
    middle = 0.5 * reach
    if logger.units == "plain":
        return {"position": (1.0, -middle), "pressure": (1.0, 0.0)}
    span = 10.0 if logger.units == "volts" else 32768.0
    return {"position": (1.2 * reach / span, -0.6 * reach), "pressure": (top / span, 0.0)}


def column_map(logger: Logger, stranger: Stranger) -> str:
    """The file for `hil-bench identify --columns`."""
    scales = _scales(logger, stranger)
    command = ("U_cmd", "V", 10.0) if logger.units != "plain" else ("u", "%", None)
    text = '[time]\ncolumn = "t"\nunit = "s"\n\n[spool_setpoint]\n'
    text += f'column = "{command[0]}"\nunit = "{command[1]}"\n'
    text += f"full_scale = {command[2]}\n" if command[2] else ""
    gain, offset = scales["position"]
    text += f'\n[position]\ncolumn = "s"\nunit = "mm"\ngain = {gain!r}\noffset = {offset!r}\n'
    gain, _ = scales["pressure"]
    for name in logger.pressures:
        text += f'\n[{name}]\ncolumn = "{name.replace("P_", "p")}"\nunit = "bar"\ngain = {gain!r}\n'
    return text


def _write(path, rows, stranger, logger, rng, offsets):
    shown = seen_by(rows, logger, offsets, rng)
    scales = _scales(logger, stranger)
    gain, offset = scales["position"]
    factor = 100.0 if logger.units == "plain" else 10.0
    place = 1e3 * (shown["position"] + logger.position_offset)
    table = {
        "t": (shown["time"], 6),
        "u" if logger.units == "plain" else "U_cmd": (factor * shown["command"], 3),
        "s": ((place - offset) / gain, 0 if logger.units == "counts" else 5),
    }
    gain, _ = scales["pressure"]
    for name in logger.pressures:
        column = shown[name] / 1e5 / gain
        table[name.replace("P_", "p")] = (column, 0 if logger.units == "counts" else 5)
    texts = [[f"{value:.{digits}f}" for value in values] for values, digits in table.values()]
    lines = [";".join(table), *(";".join(row) for row in zip(*texts, strict=True))]
    text = "\n".join(lines) + "\n"
    path.write_text(text.replace(".", ",") if logger.comma else text, encoding="utf-8")
