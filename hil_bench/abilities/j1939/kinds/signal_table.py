"""A J1939 device by table as a kind of device: a joystick, a sensor, a display."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Final

from hil_bench.abilities.j1939.kinds.ecu import EcuConfig, EcuFitting, EcuKind, EcuMessage
from hil_bench.abilities.j1939.protocol.diagnostics import HIGHEST_FMI, HIGHEST_SPN
from hil_bench.abilities.j1939.protocol.ecu import USUAL_PRIORITY, Ecu
from hil_bench.abilities.j1939.protocol.signal_table import (
    CommandSignal,
    Input,
    SentGroup,
    SentSignal,
    Show,
    SignalTable,
)
from hil_bench.abilities.j1939.protocol.signals import HIGHEST_GROUP, EcuValue, Signal
from hil_bench.abilities.j1939.protocol.transmission import MOST_BYTES
from hil_bench.config.settings import CLOCK_MILLISECOND, Key
from hil_bench.config.values import choice, integer, non_negative, nonzero, number, text, zero_or
from hil_bench.devices.axis import Drive, Fitting, Measurement
from hil_bench.devices.kinds.bindings import Surroundings
from hil_bench.devices.scripted_objects import Course
from hil_bench.plants.plant import Quantity
from hil_bench.units import si_unit

_NS = 1e-9
_PLACE_KEYS: Final = (
    Key("pgn", integer(0, HIGHEST_GROUP), example="0xFDD6"),
    Key("start_bit", integer(0, 8 * MOST_BYTES - 1), example="6"),
    Key("length", integer(2, 32), example="10"),
    Key("resolution", nonzero, 1.0),
    Key("offset", number(), 0.0),
    Key("unit", text),
)

SENT_KEYS: Final = (
    *_PLACE_KEYS,
    Key("rate_ms", zero_or(integer(1, 60_000)), None, CLOCK_MILLISECOND),
    Key("priority", integer(0, 7)),
    Key("shows", choice(Show), Show.VALUE),
    Key("neutral", non_negative, 0.0),
    Key("spn", integer(1, HIGHEST_SPN)),
    Key("fmi", integer(0, HIGHEST_FMI), 2),
)
"""The keys of a signal that a device sends, beside where its value comes from."""

DBC_KEY: Final = Key("dbc", text)
"""Names the DBC file of a device."""

TAKEN_KEYS: Final = (
    *_PLACE_KEYS,
    Key("sink", text, example='"axis1.spool_setpoint"'),
    Key("safe", number(), 0.0),
    Key("timeout_ms", zero_or(integer(10, 60_000)), 300, CLOCK_MILLISECOND),
)
"""The keys of a signal that commands an axis."""


@dataclass(frozen=True, slots=True)
class SentConfig:
    """A signal that a device sends.

    Attributes:
        name: of the signal.
        group: its PGN.
        signal: its place.
        show: what of its value.
        neutral: a value below this one is neutral.
        period: of the group [ns]; None where another signal of it says so.
        priority: of the group, in the same way.
        trouble: SPN and FMI of an error indicator; None for none.
        unit: of its value, for recordings.
        course: what moves it; None where nothing or a test does.
        start: its value before a test sets it.
        follow: name of the signal whose value it shows; None for its own.
        axis: whose quantity it shows; None where it shows none.
        quantity: that quantity.
        scale: value for one SI unit of the quantity; of a share, for the full opening.
    """

    name: str
    group: int
    signal: Signal
    show: Show
    neutral: float
    period: int | None
    priority: int | None
    trouble: tuple[int, int] | None
    unit: str
    course: Course | None = None
    start: float = 0.0
    follow: str | None = None
    axis: str | None = None
    quantity: str = ""
    scale: float = 1.0

    @property
    def is_input(self) -> bool:
        """Return True if a test sets it."""
        return self.course is None and self.follow is None and self.axis is None


@dataclass(frozen=True, slots=True)
class TakenConfig:
    """A signal that commands an axis.

    Attributes:
        name: of the signal.
        group: its PGN.
        signal: its place.
        axis: that it commands.
        scale: value of the signal for 100 %.
        safe: command while nobody commands, as a part of the full opening.
        timeout: longest time between two messages [ns]; 0 for any.
        full_opening: command of 100 % [SI].
    """

    name: str
    group: int
    signal: Signal
    axis: str
    scale: float
    safe: float
    timeout: int
    full_opening: float


@dataclass(frozen=True, slots=True)
class SignalTableConfig(EcuConfig):
    """A device by table.

    Attributes:
        sent: the signals that it sends.
        taken: those that command axes.
        dbc: the file that names signals, as the table gives it; None for none.
    """

    dbc: str | None = None
    sent: tuple[SentConfig, ...] = field(default=())
    taken: tuple[TakenConfig, ...] = field(default=())


class SignalTableKind(EcuKind[SignalTableConfig]):
    """Such a device sends and takes the signals of its table."""

    name = "table"
    record = SignalTableConfig
    keys = (DBC_KEY,)

    def messages(self, config: SignalTableConfig) -> tuple[EcuMessage, ...]:
        """Return the groups of the table, those that are taken first."""
        taken: dict[int, list[str]] = {}
        for command in config.taken:
            taken.setdefault(command.group, []).append(command.name)
        sent: dict[int, list[str]] = {}
        for signal in config.sent:
            sent.setdefault(signal.group, []).append(signal.name)
        periods = {signal.group: signal.period for signal in config.sent if signal.period}
        return (
            *(EcuMessage(group, False, 0, tuple(names)) for group, names in taken.items()),
            *(
                EcuMessage(group, True, periods.get(group, 0), tuple(names))
                for group, names in sent.items()
            ),
        )

    def full_scales(self, config: SignalTableConfig) -> Mapping[str, float]:
        """Return the full scale of each axis that a signal commands."""
        return {taken.axis: taken.full_opening for taken in config.taken}

    def fit(self, config: SignalTableConfig, ecu: Ecu, surroundings: Surroundings) -> EcuFitting:
        """Build the signals."""
        signals = build_signals(config)
        commands = {taken.name: (taken.group, _build_command(taken)) for taken in config.taken}
        table = SignalTable(ecu, _group(config, signals), commands.values())
        shown = [
            (sent, _measure(config, sent, signals, surroundings))
            for sent in config.sent
            if sent.follow is None
        ]
        inputs = {sent.name: Input(sent.start) for sent in config.sent if sent.is_input}
        acts = [
            partial(
                _follow_course,
                measurement,
                sent.course or inputs[sent.name],
                si_unit(sent.unit)[1],
            )
            for sent, measurement in shown
            if sent.axis is None
        ]

        def advance(now: int) -> None:
            for act in acts:
                act(now)
            table.advance(now)

        fitting = Fitting(
            drives=tuple(
                Drive(f"{config.name}.{taken.name}", taken.axis, commands[taken.name][1])
                for taken in config.taken
            ),
            sensors=tuple((sent.axis, measurement) for sent, measurement in shown),
            advance=advance,
        )
        values = {
            sent.name: _value(sent, signals[sent.name], inputs.get(sent.name))
            for sent in config.sent
        }
        return EcuFitting(fitting, signals, values)


def build_signals(config: SignalTableConfig) -> dict[str, SentSignal]:
    """Return the signals that a device sends, by their names."""
    return {
        sent.name: SentSignal(sent.signal, sent.show, sent.neutral, sent.trouble)
        for sent in config.sent
    }


def _group(config: SignalTableConfig, signals: Mapping[str, SentSignal]) -> list[SentGroup]:
    groups: dict[int, SentGroup] = {}
    for sent in config.sent:
        group = groups.setdefault(sent.group, SentGroup(sent.group, 0, USUAL_PRIORITY, []))
        group.signals.append(signals[sent.name])
        if sent.period is not None:
            group.period = sent.period
        if sent.priority is not None:
            group.priority = sent.priority
    return list(groups.values())


def _build_command(taken: TakenConfig) -> CommandSignal:
    return CommandSignal(
        taken.signal,
        scale=taken.scale,
        safe=taken.safe,
        timeout=taken.timeout,
        full_opening=taken.full_opening,
    )


def _measure(
    config: SignalTableConfig,
    sent: SentConfig,
    signals: Mapping[str, SentSignal],
    surroundings: Surroundings,
) -> Measurement:
    """Build the measurement that writes a value to a signal and to its followers."""
    followers = [signals[each.name] for each in config.sent if each.follow == sent.name]
    targets = [signals[sent.name], *followers]
    symbol, factor = si_unit(sent.unit)
    scale, full = sent.scale, 1.0
    quantity = Quantity(sent.name, symbol, 0)
    if sent.axis is not None:
        quantity = surroundings.axes[sent.axis].kind.by_name[sent.quantity]
        if quantity.is_share:
            full = surroundings.full_scales[sent.axis]
            scale /= full
    else:
        scale = 1.0 / factor

    def publish(value: float, now: int) -> None:  # noqa: ARG001 - it has no delay
        for target in targets:
            target.value = value * scale

    return Measurement(publish, quantity, name=f"{config.name}.{sent.name}", full=full)


def _follow_course(measurement: Measurement, course: Course, factor: float, now: int) -> None:
    measurement.take((course.value_at(now * _NS) * factor,), now)


def _value(sent: SentConfig, signal: SentSignal, given: Input | None) -> EcuValue:
    low, high = signal.limits
    takes = None if given is None else given.take
    return EcuValue(lambda: signal.shown, sent.unit, takes, low, high)


SIGNAL_TABLE: Final = SignalTableKind()
