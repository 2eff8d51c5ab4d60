"""Scenarios judged by recordings, and on a machine."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.faults.fault import NOTHING_CHANGED, FaultConfig
from hil_bench.abilities.j1939.kinds.auxiliary_valve import SET_POINT
from hil_bench.abilities.recording.quantities import check_quantities
from hil_bench.abilities.recording.reading import given_units
from hil_bench.abilities.scenario import nodes, resolve
from hil_bench.abilities.scenario.dimensions import NUMBER
from hil_bench.abilities.scenario.judgement import Judgement, judge
from hil_bench.abilities.scenario.reach import names_in, walk
from hil_bench.abilities.scenario.records import (
    FirmwareStep,
    NmtStep,
    RequirementsFile,
    Scenario,
    SyncStep,
    ticks_of,
)
from hil_bench.abilities.scenario.targets import check_unit
from hil_bench.abilities.scenario.usage import usage_problems
from hil_bench.abilities.scenario.values import Floats
from hil_bench.errors import ConfigError, NothingSeenError
from hil_bench.outside.recording.channels import TIME, Channel, Recording, recording_channels
from hil_bench.units import ONE, read_unit

# Requirements held against a recording, of the bench or of a machine.


# Checks of the columns that requirements name: units that they can be judged in.


def check_columns(
    requirements: Iterable[resolve.Requirement], recording: Recording, source: str
) -> None:
    """Refuse to judge columns whose unit is none of their quantity, or that a number leaves open.

    Args:
        requirements: which.
        recording: in the bench's units.
        source: how messages name it.

    Raises:
        ConfigError: a unit contradicts; or a number without a unit is compared with a column that
            the file has in %, deg or another unit, of which it might be meant to be.
    """
    given = {name: unit for name, unit in given_units(recording).items() if not _is_one(unit)}
    for each in requirements:
        try:
            check_quantities(recording, names_in([each.condition]))
        except ConfigError as error:
            raise ConfigError(f"{source}: {each.id}: {error}") from None
        pieces = walk([each.condition])
        for comparison in (piece for piece in pieces if isinstance(piece, nodes.Comparison)):
            names = names_in([comparison]) & given.keys()
            is_open = comparison.dimension == NUMBER and _has_plain_number(comparison)
            if names and (is_open or _has_plain_zero(comparison, given)):
                name = min(names)
                raise ConfigError(
                    f'{source}: {each.id}: {name} is in "{given[name]}" there, and is compared '
                    "with a number without a unit; give the number its unit"
                )


def _is_one(symbol: str) -> bool:
    """Return True if a unit is that of a plain number, as in ``1``."""
    unit = read_unit(symbol)
    return unit is not None and (unit.symbol, unit.factor) == (ONE.symbol, 1.0)


def _has_plain_number(comparison: nodes.Comparison) -> bool:
    sides = (comparison.left, comparison.right)
    return not comparison.symbol and any(term != 0.0 for side in sides for term in _terms(side))


def _has_plain_zero(comparison: nodes.Comparison, given: Mapping[str, str]) -> bool:
    """Return True if 0 without a unit meets a signal whose 0 is another one in the file's unit."""
    pieces = list(walk([comparison]))
    is_difference = any(isinstance(piece, nodes.Arithmetic | nodes.Rate) for piece in pieces)
    if comparison.symbol or is_difference:
        return False
    units = [read_unit(given[name]) for name in names_in([comparison]) & given.keys()]
    has_zero = any(isinstance(piece, nodes.Number) for piece in pieces)
    return has_zero and any(unit is not None and unit.offset for unit in units)


def _terms(value: nodes.Value) -> Iterator[float]:
    """Yield the numbers that are summands: what multiplies a signal has no unit."""
    if isinstance(value, nodes.Number):
        yield value.value
    elif isinstance(value, nodes.Arithmetic) and value.operation in {
        nodes.Operation.ADD,
        nodes.Operation.SUBTRACT,
    }:
        yield from _terms(value.left)
        yield from _terms(value.right)


_JITTER = 0.25  # of a tick that a row may be off its grid
_MOST_JITTER = 0.5  # of a tick, and is said then: each row is still next to a tick of its own
_MOST_TICKS = 100_000_000
_FAR = 2.0**53  # ticks: a start that is further off is as good as this


class Trace(NamedTuple):
    """A recording on the grid of its ticks.

    Attributes:
        columns: the values of each signal, NaN in the ticks without a row.
        ticks: how many.
        tick_ns: time between two [ns].
        planned: how many the run has, behind these unknown; None for a run that ends with these.
        start: when its first tick is on the clock of the recording [s].
        note: what of the recording is outside of the run, or off its ticks; empty for nothing.
        idle: what has done nothing, in words.
        remarks: what else belongs beside a pass, in words.
    """

    columns: dict[str, Floats]
    ticks: int
    tick_ns: int
    planned: int | None = None
    start: float = 0.0
    note: str = ""
    idle: Sequence[str] = ()
    remarks: Sequence[str] = ()


class Finding(NamedTuple):
    """The finding of a recording on a requirement.

    Attributes:
        requirement: which.
        judgement: what.
    """

    requirement: resolve.Requirement
    judgement: Judgement


class Judged(NamedTuple):
    """The findings of a recording on some requirements, and the recording on its ticks."""

    findings: list[Finding]
    trace: Trace


def judge_with_trace(
    file: RequirementsFile,
    signals: Recording,
    source: str,
    start: float | None = None,
    *,
    given: Mapping[str, float] | None = None,
    faults: Sequence[str] = (),
) -> Judged:
    """Judge each requirement of a file by a recording; return the recording on its ticks too.

    Args:
        file: the requirements.
        signals: the recording, in the bench's units, as `read_recording` returns it.
        source: how messages name it.
        start: when the run begins on the recording's clock [s]; None for 0 where the file states a
            duration, else for the first row.
        given: values of parameters, in their own units, that win over the file's.
        faults: those of the recording, as the labels of its events have them.

    What cannot be judged, by its unit for one, raises a `ConfigError`.
    """
    parameters = resolve.parameter_values(file, given)
    vocabulary = nodes.channel_vocabulary(recording_channels(signals), parameters)
    trace = lay_on_ticks(signals, source, start, file.duration)
    longest = math.inf if file.duration is None else file.duration
    compiled = resolve.compile_texts(file.expectations, vocabulary, longest, trace.tick_ns)
    idle = [each.removesuffix(NOTHING_CHANGED) for each in faults if each.endswith(NOTHING_CHANGED)]
    trace = trace._replace(
        idle=[f"the fault {each} has changed nothing" for each in dict.fromkeys(idle)],
        remarks=[
            f"the recording does not show the fault {each}"
            for each in file.faults
            if not {each, each + NOTHING_CHANGED} & {*faults}
        ],
    )
    check_columns(compiled, signals, source)
    return Judged([judge_trace(each, trace) for each in compiled], trace)


def judge_trace(requirement: resolve.Requirement, trace: Trace) -> Finding:
    """Judge a requirement by the signals that it names in a recording on its ticks."""
    columns = {name: trace.columns[name] for name in names_in([requirement.condition])}
    judgement = judge(
        requirement.condition,
        columns,
        ticks=trace.ticks,
        tick_ns=trace.tick_ns,
        planned=trace.planned,
        idle=trace.idle,
        remarks=trace.remarks,
    )
    return Finding(requirement, judgement)


def lay_on_ticks(
    signals: Recording, source: str, start: float | None = None, duration: float | None = None
) -> Trace:
    """Return a recording on the grid of its ticks; what lacks a row is unknown there.

    Args:
        signals: the recording.
        source: how messages name it.
        start: when the run begins on its clock [s]; None for 0 with a duration, else for its first
            row.
        duration: of the run [s]; None for up to the last row.

    A `NothingSeenError` says that its rows are too few, a `ConfigError` that they lie on no grid.
    """
    times = np.asarray(signals[TIME.name], dtype=np.float64)
    rows, tick_ns, jitter = _number_rows(times, source)
    if start is None:
        start = float(times[0]) if duration is None else 0.0
    before = (float(times[0]) - start) * 1e9 / tick_ns
    rows += round(min(max(before, -_FAR), _FAR))
    planned = None if duration is None else ticks_of(duration, tick_ns)
    end = int(rows[-1]) + 1 if planned is None else planned
    is_inside = (rows >= 0) & (rows < end)
    places = rows[is_inside]
    ticks = int(places[-1]) + 1 if len(places) else 0
    _check_span(ticks, source)
    columns = {}
    for name in signals.dtype.names or ():
        columns[name] = np.full(ticks, np.nan)
        columns[name][places] = signals[name][is_inside]
    begin = float(times[0]) - int(rows[0]) * tick_ns / 1e9
    is_apart = not is_inside.all() or (planned is not None and rows[0] > 0)
    note = _outside(times, begin, None if planned is None else (planned - 1) * tick_ns / 1e9)
    notes = "; ".join(filter(None, (note if is_apart else "", jitter)))
    return Trace(columns, ticks, tick_ns, planned, begin, notes)


def _number_rows(times: Floats, source: str) -> tuple[npt.NDArray[np.int64], int, str]:
    """Return the tick of each row from the first one on, the time between two [ns], and a note.

    Raises:
        ConfigError: the rows lie on no grid.
        NothingSeenError: they are too few.
    """
    if len(times) < 2:
        raise NothingSeenError(f"{source}: has {len(times)} rows; give a recording of two or more")
    if not np.isfinite(times).all():
        row = int(np.argmin(np.isfinite(times)))
        raise ConfigError(f"{source}: the time of row {row + 1} is no number")
    steps = np.diff(times)
    if steps.min() <= 0.0:
        first = int(np.argmax(steps <= 0.0))
        was, now = map(_show_time, times[first : first + 2])
        what = f"the time does not go on in row {first + 2}: {was} s, and then {now} s"
        right = "'hil-bench decode --tick' lays a log of frames on ticks"
        raise ConfigError(f"{source}: {what}; give rising times ({right})")
    usual = float(np.median(steps))
    tick_ns = _find_tick(times, usual)
    if not tick_ns:
        raise ConfigError(f"{source}: its rows are not evenly spaced, or less than 1 ns apart")
    places = (times - times[0]) / (tick_ns * 1e-9)
    rows = np.rint(places)
    _check_span(rows[-1] + 1, source)
    if np.abs(places - rows).max() <= _JITTER and np.diff(rows).min() > 0.0:
        return rows.astype(np.int64), tick_ns, ""
    return _number_uneven(times, np.rint(steps / usual), source)


def _find_tick(times: Floats, usual: float) -> int:
    """Return the time between two rows [ns].

    Of times since 1970 a double keeps 0.2 us. So their interval is that of the whole recording, in
    as few digits as they allow.

    Args:
        times: of the rows [s].
        usual: the median of the times between two [s].
    """
    rounding = float(np.spacing(np.abs(times).max()))
    if rounding < 1e-9:
        return round(usual * 1e9)
    rows = float(np.rint(np.diff(times) / usual).sum())
    mean = float(times[-1] - times[0]) / rows
    rounded = [round(mean, digits) for digits in range(10)]
    close = (each for each in rounded if abs(each - mean) <= rounding / rows)
    return round(next(close, mean) * 1e9)


def _number_uneven(
    times: Floats, counts: Floats, source: str
) -> tuple[npt.NDArray[np.int64], int, str]:
    """Return the ticks of rows that jitter or drift against the usual time between two of them.

    Args:
        times: of the rows [s].
        counts: how many ticks each is behind the one before.
        source: how messages name the recording.

    Raises:
        ConfigError: a row is nearer to the tick of another one.
    """
    rows = np.concatenate(([0.0], np.cumsum(counts)))
    tick = float(times[-1] - times[0]) / max(float(rows[-1]), 1.0)
    tick_ns = round(tick * 1e9)
    off = times - times[0] - rows * tick
    off -= (off.max() + off.min()) / 2.0
    worst = int(np.argmax(np.abs(off)))
    if counts.min() < 1.0 or abs(off[worst]) > _MOST_JITTER * tick:
        raise ConfigError(
            f"{source}: its rows are not evenly spaced, as at {_show_time(times[worst])} s; "
            "give one with a row a tick; 'decode --tick' makes one of a bus log"
        )
    rounded_away = float(rows[-1]) * abs(tick - tick_ns * 1e-9)  # as of 25.6 kHz
    most = 1e3 * (abs(off[worst]) + rounded_away)
    note = f"its rows are up to {most:.3g} ms off ticks of {tick_ns / 1e6:.6g} ms"
    return rows.astype(np.int64), tick_ns, f"{note}, and so are the times of a verdict"


def _check_span(ticks: float, source: str) -> None:
    if ticks > _MOST_TICKS:
        raise ConfigError(f"{source}: spans {ticks:.0f} ticks; give at most {_MOST_TICKS}")


def _outside(times: Floats, start: float, length: float | None) -> str:
    """Describe the time span of a recording's rows and the judged span, of its clock."""
    end = times[-1] if length is None else start + length
    return (
        f"its rows are from {_show_time(times[0])} to {_show_time(times[-1])} s; judged are "
        f"{_show_time(start)} to {_show_time(end)} s, --start S says where that begins"
    )


def _show_time(time: float) -> str:
    """Return a time [s] in nine digits, of times since 1970 up to the microsecond."""
    return f"{time:.9g}" if abs(time) < 1e6 else f"{time:.6f}".rstrip("0").rstrip(".")


# Scenarios on a machine: what of them exists there, and what is refused before anything moves.
#
# There are the set-point of the valve and what its drivers tell. Faults, loads and whatever else
# needs the virtual bench is refused by name.


_MANUAL = "manual"
_RIGHT = "leave it out on a machine"


@dataclass(frozen=True, slots=True)
class MachineScenario:
    """A scenario that a machine can play.

    Attributes:
        scenario: as loaded.
        parameters: the SI value of each parameter.
        set_points: of the valve.
        requirements: its expectations.
    """

    scenario: Scenario
    parameters: Mapping[str, float]
    set_points: "SetPoints"
    requirements: tuple[resolve.Requirement, ...]


class SetPoints:
    """The set-point of a valve over the time of a run: 0 until the first step.

    Args:
        actions: the steps, in the order of time, all for that valve.
        tick_ns: time between two ticks [ns].
    """

    def __init__(self, actions: Iterable[tuple[int, resolve.SetAction]], tick_ns: int) -> None:
        self._tick = tick_ns * 1e-9
        self._courses: list[tuple[Sequence[float], Sequence[float]]] = []
        for tick, action in actions:
            points = action.points(tick, self._at(tick))
            self._courses.append(([t for t, _ in points], [value for _, value in points]))

    def at(self, time: float) -> float:
        """Return the set-point [-] at a time of the run [s]."""
        return self._at(round(time / self._tick, 6))  # a tick is a tick, however it was computed

    def _at(self, tick: float) -> float:
        for ticks, values in reversed(self._courses):
            if ticks[0] <= tick:
                return float(np.interp(tick, ticks, values))
        return 0.0


def prepare_for_machine(
    scenario: Scenario,
    given: Mapping[str, float],
    *,
    tick_ns: int,
    valve: str,
    channels: Iterable[Channel],
) -> MachineScenario:
    """Return a scenario that a machine can play.

    Args:
        scenario: as loaded.
        given: values of parameters, in their own units, that win over the file's.
        tick_ns: at which its steps act on the bench [ns].
        valve: the name of the valve's node.
        channels: what the drivers tell.

    Raises:
        ConfigError: something of it does not exist there, or does not fit; a line a problem.
    """
    values = resolve.parameter_values(scenario, given)
    actions = resolve.resolve_steps(scenario, tick_ns, values)
    problems = [
        *_controller_problems(scenario),
        *usage_problems(scenario),
        *(line for each in actions for line in _step_problems(each, f"{valve}.{SET_POINT}")),
    ]
    requirements: tuple[resolve.Requirement, ...] = ()
    try:
        vocabulary = nodes.channel_vocabulary(channels, values)
        requirements = resolve.compile_expectations(scenario, vocabulary, tick_ns)
    except ConfigError as error:
        problems.append(f"{error}; a machine has only what its sensors measure")
    if problems:
        raise ConfigError("\n".join(problems))
    moves = [
        (each.tick, each.action) for each in actions if isinstance(each.action, resolve.SetAction)
    ]
    return MachineScenario(scenario, values, SetPoints(moves, tick_ns), requirements)


def lay_samples(samples: Recording, channels: Mapping[str, str], ticks: int, tick: float) -> Trace:
    """Return samples on the grid of a run; what was not sampled is unknown there.

    Args:
        samples: the first one at time 0 of the run.
        channels: of each signal of the run, the field of the samples.
        ticks: of the run.
        tick: time between two [s].
    """
    times = samples[TIME.name] - samples[TIME.name][0]
    places = np.rint(times / tick).astype(np.int64)
    is_inside = places < ticks
    columns = {}
    for name, field in channels.items():
        columns[name] = np.full(ticks, math.nan)
        columns[name][places[is_inside]] = samples[field][is_inside]
    return Trace(columns, ticks, round(tick * 1e9), ticks)


def _controller_problems(scenario: Scenario) -> Iterator[str]:
    controller = scenario.controller
    if controller is not None and controller.example != _MANUAL:
        right = f'give example = "{_MANUAL}", or no [controller]'
        yield f"{scenario.path}: controller: on a machine the steps alone drive; {right}"


def _step_problems(timed: resolve.TimedAction, target: str) -> Iterator[str]:
    action, place = timed.action, timed.place
    match action:
        case FaultConfig():
            what = f"the fault {action.kind} of {action.target} needs the virtual bench; {_RIGHT}"
            yield f"{place}: {what}"
        case resolve.SetAction() if action.target != target:
            wrong = f"{action.target} cannot be set on a machine"
            yield f"{place}: {wrong}; only {target} can"
        case resolve.SetAction():
            try:
                for symbol in action.units:
                    check_unit(target, symbol, ONE.symbol)
            except ConfigError as error:
                yield f"{place}: {error}"
            for value in action.values:
                if not -1.0 <= value <= 1.0:
                    yield f"{place}: {value:g} is out of range; give -1 to 1 of full opening"
        case NmtStep() | SyncStep():
            yield f"{place}: NMT commands and SYNC are the test's own on a machine; {_RIGHT}"
        case FirmwareStep():
            yield f"{place}: there is no firmware on a machine; {_RIGHT}"
