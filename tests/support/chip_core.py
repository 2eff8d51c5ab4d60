"""A core for the parts of a chip by themselves."""

from collections.abc import Callable

from hil_bench.abilities.controllers.elf.calls import Alarm, find_calls


class Core:
    """A core without instructions: time passes by `run`."""

    def __init__(self) -> None:
        self.time = 0
        self.lines: dict[int, bool] = {}
        self._timeline = find_calls().Timeline()

    def now(self) -> int:
        return self.time

    def alarm(self, time: int, action: Callable[[], None]) -> Alarm:
        return self._timeline.add(time, action)

    def pend(self, exception: int) -> None:
        self.lines[exception] = True

    def hold_line(self, interrupt: int, *, is_active: bool) -> None:
        self.lines[interrupt] = is_active

    def run(self, until: int) -> None:
        while (time := self._timeline.next_time(until + 1)) <= until:
            self.time = max(time, self.time)
            self._timeline.fire(self.time)
        self.time = until
