"""Conversion of manual commands to a running bench into the steps of a scenario."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from hil_bench.abilities.scenario.records import FaultStep, Reference, SetStep, Step
from hil_bench.session.live_faults import fault_table
from hil_bench.units import si_unit

_DIGITS = 9  # of a time: whole nanoseconds


class JournalSteps:
    """The steps that do again what a journal tells.

    What was set or broken before the beginning, and still is, becomes a step at 0 s.

    Args:
        hello: what the bench says of itself.
        begin: bench time that the scenario has at `lead` [s].
        end: bench time from which on commands are left out [s].
        lead: time of the scenario before its first step, for the controller to start [s].

    Attributes:
        steps: in the order in which they act.
        remarks: what a scenario cannot have, a line each.
    """

    def __init__(
        self, hello: Mapping[str, Any], begin: float, end: float, lead: float = 0.0
    ) -> None:
        self.remarks: list[str] = []
        self._hello = hello
        self._begin, self._end, self._lead = begin, end, lead
        self._faults: dict[int, tuple[FaultStep, float | None]] = {}
        self._settings: list[SetStep] = []

    @property
    def steps(self) -> tuple[Step, ...]:
        """In the order in which they act."""
        limit = self._at(self._end)
        faults = [
            step
            for step, ends in self._faults.values()
            if (ends is None or ends > 0.0) and _seconds(step) < limit
        ]
        return tuple(sorted([*self._latest(), *faults], key=_seconds))

    def add(self, entries: Iterable[Mapping[str, Any]]) -> None:
        """Take entries of a journal, the oldest first."""
        for entry in entries:
            if entry["time"] >= self._end:
                return
            match entry["do"]:
                case "begin_fault":
                    self._begin_fault(entry)
                case "clear_fault":
                    self._clear(entry["fields"].get("number"), entry["time"])
                case "set_plant" | "set_object":
                    self._set(entry)

    def _at(self, time: float) -> float:
        """Return the time in the scenario: 0 for what was before the beginning."""
        if time < self._begin:
            return 0.0
        return round(time - self._begin + self._lead, _DIGITS)

    def _begin_fault(self, entry: Mapping[str, Any]) -> None:
        fields = entry["fields"]
        if not fields:
            self.remarks.append(f"the fault at {entry['time']:g} s has too long arguments")
            return
        begins = max(entry["time"], fields.get("arguments", {}).get("at") or 0.0)
        table = fault_table(fields, self._hello)
        kind, target = table.pop("kind"), table.pop("target")
        ends = None if "for_s" not in table else begins + table["for_s"]
        step = FaultStep(self._at(begins), kind, target, tuple(sorted(table.items())))
        gone = ends is not None and ends <= self._begin
        self._faults[entry["number"]] = step, 0.0 if gone else None

    def _clear(self, number: int | None, time: float) -> None:
        if number is not None and number not in self._faults:
            self.remarks.append(f"fault {number}, cleared at {time:g} s, was not begun by hand")
        for each in [*self._faults] if number is None else [number]:
            if each in self._faults:
                self._end_fault(each, time)

    def _end_fault(self, number: int, time: float) -> None:
        step, ends = self._faults[number]
        if ends is not None:
            return
        lasts = round(self._at(time) - _seconds(step), _DIGITS) if time > self._begin else 0.0
        values = dict(step.values)
        values["for_s"] = min(lasts, float(str(values.get("for_s", lasts))))
        self._faults[number] = replace(step, values=tuple(sorted(values.items()))), lasts

    def _set(self, entry: Mapping[str, Any]) -> None:
        fields = entry["fields"]
        value = fields.get("value")
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            where = f"at {entry['time']:g} s"
            self.remarks.append(f"a value that is no number was set {where}; scenarios have none")
            return
        owner, name = (
            (fields["axis"], fields["quantity"])
            if entry["do"] == "set_plant"
            else (fields["node"], fields["name"])
        )
        factor = self._factor(owner, name)
        step = SetStep(self._at(entry["time"]), f"{owner}.{name}", float(value) * factor)
        self._settings.append(step)

    def _factor(self, owner: str, name: str) -> float:
        """Return the value of 1 in SI: a J1939 signal is set in its own unit."""
        signals = self._hello.get("ecus", {}).get(owner, {}).get("signals", {})
        return si_unit(signals[name]["unit"])[1] if name in signals else 1.0

    def _latest(self) -> Sequence[SetStep]:
        """Return the settings, of those at one time for one target the last one."""
        return list({(step.at, step.target): step for step in self._settings}.values())


def _seconds(step: Step) -> float:
    assert not isinstance(step.at, Reference)  # noqa: S101 - a journal names no parameters
    return step.at
