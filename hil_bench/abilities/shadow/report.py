"""Output of `hil-bench shadow` while it follows a machine, and at its end."""

import json
import math
import sys
from collections.abc import Mapping

import numpy as np

from hil_bench.abilities.common.shown_units import display_unit
from hil_bench.abilities.common.work import WorkItem, WorkView
from hil_bench.abilities.shadow.axis_twin import Correction, Residual, Window
from hil_bench.abilities.shadow.twin import Sample, Shadow, widening
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.outside.recording.channels import TIME, Channel, Recording, recording_dtype

Limits = Mapping[str, Mapping[str, float]]
"""By axis and quantity, in SI units."""

_NAMES = {"status_word": "state of the valve", "set-point": "set-point of the valve"}
_PATIENCE = 1.0
"""Time without a twin that follows after which it is said what is missing [s]."""


class ShadowReport:
    """The report on a shadow.

    Args:
        shadow: the twin.
        limits: RMS of a window that is too much.
        is_quiet: whether nothing is said while it runs.
        keeps: whether the values side by side are kept for `recording`.

    Attributes:
        channels: of the rows that people see: each value of the machine, and the twin's.
        view: where they see it.
    """

    def __init__(self, shadow: Shadow, limits: Limits, *, is_quiet: bool, keeps: bool) -> None:
        self._shadow = shadow
        self._limits = limits
        self._is_quiet = is_quiet
        self._keeps = keeps
        self.view = WorkView()
        self.channels = tuple(
            Channel(f"{axis}.{quantity}{side}", unit)
            for axis in shadow.axes
            for quantity, unit in shadow.units.items()
            for side in ("", "_twin")
        )
        self._places = {channel.name: place for place, channel in enumerate(self.channels, 1)}
        self._present = [math.nan] * (1 + len(self.channels))
        self._rows: list[Sample] = []
        self._windows: list[Window] = []
        self._corrections: list[Correction] = []
        self._following: dict[str, bool] = {}
        self._waiting_since = dict.fromkeys(shadow.axes, 0.0)
        self._said: dict[str, frozenset[str]] = {}
        self._is_seen = False
        self._frames, self._heard_at, self._now = 0, 0.0, 0.0

    def take(self, now: float) -> None:
        """Take out what the shadow found since the last call, and say it.

        Args:
            now: time since the start [s].
        """
        shadow = self._shadow
        if shadow.frames != self._frames:
            self._frames, self._heard_at = shadow.frames, now
        self._now = now
        if self._keeps:
            self._rows.extend(shadow.samples)
        if self.view.is_watched:
            self._show_samples()
        shadow.samples.clear()
        for axis in shadow.axes:
            self._take_state(axis, now)
        while shadow.windows:
            window = shadow.windows.popleft()
            self._windows.append(window)
            self._say(self._line(window), to_stdout=True)
            self._is_seen = False
        if self.view.is_watched and not self._is_seen:
            self._is_seen = True
            self._show_state()

    @property
    def verdict(self) -> tuple[str, ExitCode]:
        """The verdict so far, in a word and as an exit code."""
        if self._exceeded:
            return "differs", ExitCode.CHECK_FAILED
        if self._unjudged:
            return "not compared", ExitCode.INCONCLUSIVE
        if self._gaps():
            return "in part", ExitCode.INCONCLUSIVE
        return "follows", ExitCode.DONE

    def _gaps(self) -> dict[str, dict[str, tuple[float, float, float]]]:
        """Return the gaps longer than a twin's patience since the first window of its axis.

        Returns:
            By axis and quantity: its first gap, from and to, and for how long it was compared [s].
        """
        end = self._shadow.now + self._now - self._heard_at
        found: dict[str, dict[str, tuple[float, float, float]]] = {}
        for axis, twin in self._shadow.axes.items():
            windows = [window for window in self._windows if window.axis == axis]
            for quantity in twin.compared if windows else ():
                seen = [each for each in windows if each.residuals[quantity].count]
                starts = [windows[0].begin, *(each.end for each in seen)]
                gaps = zip(starts, [*(each.begin for each in seen), end], strict=True)
                long = [gap for gap in gaps if gap[1] - gap[0] > twin.patience]
                if long:
                    time = sum(each.end - each.begin for each in seen)
                    found.setdefault(axis, {})[quantity] = *long[0], time
        return found

    @property
    def _unjudged(self) -> list[str]:
        judged = {window.axis for window in self._windows}
        return [axis for axis in self._shadow.axes if axis not in judged]

    @property
    def _exceeded(self) -> int:
        return sum(self._is_beyond(window) for window in self._windows)

    def recording(self) -> Recording:
        """Return all values side by side, a row a value; what a row does not bring is NaN."""
        names = dict.fromkeys((axis, quantity) for _, axis, quantity, _, _ in self._rows)
        channels = [
            Channel(f"{axis}.{quantity}{side}", self._shadow.units[quantity])
            for axis, quantity in names
            for side in ("", "_twin")
        ]
        table = np.full(len(self._rows), np.nan, dtype=recording_dtype([TIME, *channels]))
        for row, (time, axis, quantity, machine, twin) in zip(table, self._rows, strict=True):
            row["time"] = time
            row[f"{axis}.{quantity}"], row[f"{axis}.{quantity}_twin"] = machine, twin
        return table

    def finish(self, duration: float, *, as_json: bool) -> None:
        """Print the verdict after a time [s]."""
        verdict, _ = self.verdict
        exceeded = self._exceeded
        if as_json:
            print(json.dumps(self._content(verdict, exceeded, duration), indent=2))
            return
        if self._windows:
            self._say(self._summary(verdict, exceeded), to_stdout=True)
        for axis in self._unjudged:
            print(f"{axis}: {self._why_unjudged(axis, duration)}", file=sys.stderr)

    def _show_samples(self) -> None:
        """Show the newest values of machine and twin, at the time of the newest frame."""
        for _, axis, quantity, machine, twin in self._shadow.samples:
            self._present[self._places[f"{axis}.{quantity}"]] = machine
            self._present[self._places[f"{axis}.{quantity}_twin"]] = twin
        if self._shadow.samples:
            self._present[0] = self._shadow.now
            self.view.put_row(tuple(self._present))

    def _show_state(self) -> None:
        """Show which axes follow, and the worst window of each quantity."""
        following = [axis for axis, is_so in self._following.items() if is_so]
        waiting = [axis for axis in self._shadow.axes if axis not in following]
        words = [f"{axis}: the twin follows" for axis in following]
        words += [f"{axis} waits" for axis in waiting]
        items = [
            WorkItem(
                f"{axis} {quantity}",
                "differs" if self._share(window, quantity) > 1.0 else "follows",
                self._worst_text(quantity, window, residual),
            )
            for axis, residuals in self._worst().items()
            for quantity, (window, residual) in residuals.items()
        ]
        counts = {"windows": len(self._windows), "beyond a limit": self._exceeded}
        self.view.show(now="; ".join(words), counts=counts, items=items)

    def _worst_text(self, quantity: str, window: Window, residual: Residual) -> str:
        symbol = self._shadow.units[quantity]
        return (
            f"RMS {_text(symbol, residual.rms)}, largest {_text(symbol, residual.largest)}, "
            f"limit {_text(symbol, self._limit(window, quantity))}"
        )

    def _take_state(self, axis: str, now: float) -> None:
        """Say when the twin of an axis begins to follow, what it waits for, and what it adopted."""
        twin = self._shadow.axes[axis]
        while twin.corrections:
            correction = twin.corrections.popleft()
            self._corrections.append(correction)
            self._say(_correction_line(correction))
        is_following = twin.begin is not None
        if is_following and not self._following.get(axis):
            state = f"; its valve is {twin.valve.state}" if twin.valve else ""
            self._say(f"{twin.begin:8.2f} s  {axis}  the twin follows{state}")
            self._said.pop(axis, None)
        if is_following:
            self._waiting_since[axis] = now
        elif now - self._waiting_since[axis] >= _PATIENCE:
            self._say_what_is_missing(axis, now)
        self._is_seen = self._is_seen and self._following.get(axis) == is_following
        self._following[axis] = is_following

    def _say_what_is_missing(self, axis: str, now: float) -> None:
        missing = self._missing(axis)
        if missing and missing.keys() != self._said.get(axis):
            self._said[axis] = frozenset(missing)
            self._waiting_since[axis] = now
            self._say(f"{self._shadow.now:8.2f} s  {axis}  waits for {_joined(missing)}")

    def _missing(self, axis: str) -> dict[str, str]:
        """Return the inputs that the twin of an axis lacks, with their source, and the reasons."""
        missing = self._shadow.axes[axis].missing(self._shadow.now)
        return {
            _NAMES.get(name, name) + self._place(axis, name): why for name, why in missing.items()
        }

    def _place(self, axis: str, quantity: str) -> str:
        """Return the device that a quantity comes from, with its PDO and its NMT state."""
        for reading in self._shadow.readings:
            if (reading.axis, reading.quantity) == (axis, quantity):
                place = f"node {reading.node_id}, PDO 0x{self._shadow.identifier(reading):03X}"
                state = self._shadow.states.reported.get(reading.node_id)
                if state not in {None, NmtState.OPERATIONAL}:
                    place += f", {state.name}"
                return f" ({place})"
        return ""

    def _why_unjudged(self, axis: str, duration: float) -> str:
        heard = f"nothing was compared in {duration:.1f} s, {self._shadow.frames} frames heard"
        missing = self._missing(axis)
        if missing:
            return f"{heard}; missing: {_joined(missing)}"
        return f"{heard}; the twin followed for less than a whole --horizon"

    def _say(self, text: str, *, to_stdout: bool = False) -> None:
        if not self._is_quiet:
            print(text, file=sys.stdout if to_stdout else sys.stderr, flush=True)

    def _worst(self) -> dict[str, dict[str, tuple[Window, Residual]]]:
        """Return, an axis, the window of each quantity that is worst by its own limit."""
        worst: dict[str, dict[str, tuple[Window, Residual]]] = {}
        for window in self._windows:
            of_axis = worst.setdefault(window.axis, {})
            for quantity, residual in window.residuals.items():
                if residual.count and (
                    quantity not in of_axis
                    or self._share(window, quantity) >= self._share(of_axis[quantity][0], quantity)
                ):
                    of_axis[quantity] = window, residual
        return worst

    def _limit(self, window: Window, quantity: str) -> float:
        return self._limits[window.axis][quantity] * widening(window.lateness)

    def _share(self, window: Window, quantity: str) -> float:
        """Return the RMS of a quantity as a share of its limit; 0 where no value came."""
        residual = window.residuals[quantity]
        return residual.rms / self._limit(window, quantity) if residual.count else 0.0

    def _is_beyond(self, window: Window) -> bool:
        return any(self._share(window, quantity) > 1.0 for quantity in window.residuals)

    def _line(self, window: Window) -> str:
        cells = []
        for quantity, residual in window.residuals.items():
            if residual.count:
                mark = " !" if self._share(window, quantity) > 1.0 else "  "
                cells.append(
                    f"{quantity} {_text(self._shadow.units[quantity], residual.rms)}{mark}"
                )
        line = f"{window.end:8.2f} s  {window.axis}  {'  '.join(cells)}{_late_text(window)}"
        return line.rstrip()

    def _summary(self, verdict: str, exceeded: int) -> str:
        lines = [f"\n{len(self._windows)} windows, {exceeded} of them beyond a limit; the worst:"]
        for axis, residuals in self._worst().items():
            for quantity, (window, residual) in residuals.items():
                judged = "TOO MUCH" if self._share(window, quantity) > 1.0 else "ok"
                lines.append(
                    f"  {axis} {quantity:15} {self._worst_text(quantity, window, residual)}: "
                    f"{judged}{_late_text(window)}"
                )
        for axis, gaps in self._gaps().items():
            together: dict[tuple[float, float, float], list[str]] = {}
            for quantity, gap in gaps.items():
                together.setdefault(gap, []).append(quantity)
            for (begin, end, time), quantities in together.items():
                lines.append(
                    f"  {axis} {', '.join(quantities)}: compared for {time:.2f} s, "
                    f"and not from {begin:.2f} s to {end:.2f} s"
                )
            if missing := self._missing(axis):
                lines.append(f"  {axis} misses at the end {_joined(missing)}")
        texts = {
            "follows": "the machine does what its twin does",
            "in part": "the machine did what its twin did while it could be compared",
            "differs": "the machine does something else than its twin",
            "not compared": "not every axis could be compared",
        }
        others = ", ".join(self._shadow.others)
        without = f"; without sensors, so not compared: {others}" if others else ""
        return "\n".join([*lines, f"verdict: {verdict}; {texts[verdict]}{without}"])

    def _content(self, verdict: str, exceeded: int, duration: float) -> dict[str, object]:
        return {
            "verdict": verdict,
            "seconds": duration,
            "frames": self._shadow.frames,
            "windows": len(self._windows),
            "exceeded": exceeded,
            "without_sensors": self._shadow.others,
            "missing": {axis: self._missing(axis) for axis in self._shadow.axes},
            "gaps": {
                axis: {
                    quantity: {"begin": begin, "end": end, "compared": time}
                    for quantity, (begin, end, time) in gaps.items()
                }
                for axis, gaps in self._gaps().items()
            },
            "corrections": [correction._asdict() for correction in self._corrections],
            "worst": {
                axis: {
                    quantity: {
                        "rms": residual.rms,
                        "largest": residual.largest,
                        "limit": self._limit(window, quantity),
                        "lateness": window.lateness,
                        "unit": self._shadow.units[quantity],
                    }
                    for quantity, (window, residual) in residuals.items()
                }
                for axis, residuals in self._worst().items()
            },
        }


def _correction_line(correction: Correction) -> str:
    time, axis, twin, machine = correction
    return (
        f"{time:8.2f} s  {axis}  the machine's valve is {machine}, the twin's was {twin}: "
        "it takes over the state, and the window does not count"
    )


def _late_text(window: Window) -> str:
    """Return a note if the limits of a window are wider, since frames came late."""
    if widening(window.lateness) == 1.0:
        return ""
    return f"  (frames late by {window.lateness * 1e3:.0f} ms)"


def _joined(missing: Mapping[str, str]) -> str:
    return "; ".join(f"{what}: {why}" for what, why in missing.items())


def _text(symbol: str, value: float) -> str:
    unit = display_unit(symbol)
    return f"{unit.from_si(value):.3f} {unit.symbol}"
