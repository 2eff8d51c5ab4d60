"""Requirements held against a recording, of the bench or of a machine."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import TIME, Recording, recording_channels
from hil_bench.scenario.column_checks import check_columns
from hil_bench.scenario.judgement import Judgement, judge
from hil_bench.scenario.load import load_requirements
from hil_bench.scenario.resolve import Requirement, compile_texts
from hil_bench.scenario.sliding import Floats
from hil_bench.scenario.vocabulary import channel_vocabulary
from hil_bench.scenario.witness import names_in

_JITTER = 0.25  # of a tick that a row may be off its grid
_MOST_TICKS = 100_000_000


class Trace(NamedTuple):
    """A recording on the grid of its ticks.

    Attributes:
        columns: the values of each signal, NaN in the ticks without a row.
        ticks: how many.
        tick_ns: time between two [ns].
    """

    columns: dict[str, Floats]
    ticks: int
    tick_ns: int


class Finding(NamedTuple):
    """What a recording says of a requirement.

    Attributes:
        requirement: which.
        judgement: what.
    """

    requirement: Requirement
    judgement: Judgement


class Judged(NamedTuple):
    """What a recording says of some requirements, and the recording on its ticks."""

    findings: list[Finding]
    trace: Trace


def judge_with_trace(requirements: Path, signals: Recording, source: str) -> Judged:
    """Return what a recording says of each requirement of a file, and the recording on its ticks.

    Args:
        requirements: a file with ``[[expect]]``: a scenario, or that alone.
        signals: the recording, in the bench's units, as `read_recording` returns it.
        source: how messages name it.

    What cannot be judged, by its unit for one, raises a `ConfigError`.
    """
    expectations, parameters = load_requirements(requirements)
    vocabulary = channel_vocabulary(recording_channels(signals), parameters)
    compiled = compile_texts(expectations, vocabulary)
    check_columns(compiled, signals, source)
    trace = lay_on_ticks(signals, source)
    findings = [judge_trace(each, trace) for each in compiled]
    return Judged(findings, trace)


def judge_trace(requirement: Requirement, trace: Trace) -> Finding:
    """Return what a recording on its ticks says of a requirement, by the signals that it names."""
    columns = {name: trace.columns[name] for name in names_in([requirement.condition])}
    judgement = judge(requirement.condition, columns, ticks=trace.ticks, tick_ns=trace.tick_ns)
    return Finding(requirement, judgement)


def lay_on_ticks(signals: Recording, source: str) -> Trace:
    """Return a recording on the grid of its ticks; what lacks a row is unknown there.

    Args:
        signals: the recording.
        source: how messages name it.

    Raises:
        ConfigError: its rows are too few, or lie on no grid.
    """
    times = np.asarray(signals[TIME.name], dtype=np.float64)
    steps = np.diff(times)
    if not len(steps) or not np.isfinite(times).all() or steps.min() <= 0.0:
        raise ConfigError(f"{source}: times do not go on; give a recording of two rows or more")
    tick = round(float(np.median(steps)) * 1e9) * 1e-9
    places = (times - times[0]) / tick if tick else times
    rows = np.rint(places)
    if not tick or np.abs(places - rows).max() > _JITTER or len(np.unique(rows)) < len(rows):
        raise ConfigError(f"{source}: its rows are not evenly spaced; give one with a row a tick")
    ticks = int(rows[-1]) + 1
    if ticks > _MOST_TICKS:
        raise ConfigError(f"{source}: spans {ticks} ticks; give at most {_MOST_TICKS}")
    columns = {}
    for name in signals.dtype.names or ():
        columns[name] = np.full(ticks, np.nan)
        columns[name][rows.astype(np.int64)] = signals[name]
    return Trace(columns, ticks, round(tick * 1e9))
