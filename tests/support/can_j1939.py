"""`can-j1939` 2.0.12 (MIT) in virtual time.

Its thread is not started: a test calls what the thread would, and its clock is the test's.
"""

from typing import Any

import j1939
import pytest
from j1939 import electronic_control_unit, j1939_21


class Clock:
    """Virtual time [ns], where the library asks for the wall clock."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 0
        for module in (electronic_control_unit, j1939_21):
            monkeypatch.setattr(module, "time", self)

    def time(self) -> float:
        return self.now * 1e-9


class TheirEcu(j1939.ElectronicControlUnit):  # type: ignore[misc]
    """Their ECU without its thread."""

    def _async_job_thread(self) -> None:
        """Do nothing: `work` does what is due."""

    def work(self, now: float) -> None:
        self.j1939_dll.async_job_thread(now)
        for event in list(self._timer_events):
            if event["deadline"] <= now:
                self._timer_events.remove(event)
                if event["callback"](event["cookie"]):
                    self._timer_events.append(event | {"deadline": now + event["delta_time"]})


def their_dm1(application: Any, codes: list[dict[str, int]]) -> None:
    """Let them send DM1 each second with the warning lamp and these codes."""
    lamps = dict.fromkeys(("pl", "rsl", "mil"), j1939.DtcLamp.OFF)
    dm1 = j1939.Dm1(application)
    dm1.start_send(lambda: ({**lamps, "awl": j1939.DtcLamp.ON}, [dict(code) for code in codes]))
