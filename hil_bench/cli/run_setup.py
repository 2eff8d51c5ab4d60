"""Common parts of both ways to `hil-bench run`: the set-up before the first tick, and the end."""

import argparse
import contextlib
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from hil_bench.bench.configuration import BenchConfig, FaultConfig
from hil_bench.bench.configuration.plausibility import find_doubts
from hil_bench.bench.configuration.records import Served, Serving
from hil_bench.cli.bench_bus import OpenBus, open_bus
from hil_bench.cli.collection import collection_put_off
from hil_bench.cli.device_table import device_table
from hil_bench.cli.doubts import warn_of
from hil_bench.cli.exit_codes import Ending, ExitCode
from hil_bench.cli.helpers import Helper, Helpers
from hil_bench.cli.interruption import Interruption, interruption
from hil_bench.cli.recording_arguments import recording_code, recording_wish
from hil_bench.cli.results import print_results
from hil_bench.errors import HilBenchError
from hil_bench.outside.recording.inline_recorder import RecordingSink
from hil_bench.session.recording import recorded
from hil_bench.session.session import Session, open_session


class RunSetup(NamedTuple):
    """A bench that is about to run, and what is open around it.

    Attributes:
        args: the command line.
        config: of the bench.
        session: the bench, not yet powered on.
        bus: its buses.
        served: what its parts have opened for others.
        recording: what is recorded, None for nothing.
        wish: whether somebody wants the end.
    """

    args: argparse.Namespace
    config: BenchConfig
    session: Session
    bus: OpenBus
    served: Sequence[Served]
    recording: RecordingSink | None
    wish: Interruption

    def watch(self, *helpers: Helper) -> Helpers:
        """Return the guard of the processes of this run, and of further ones."""
        return Helpers(
            [*self.bus.helpers, *(each for part in self.served for each in part.helpers), *helpers],
            ends_on_loss=self.args.end_on_loss,
            has_lost_data=lambda: self._recording_code() is not ExitCode.DONE,
        )

    def announcement(self) -> Callable[[], None]:
        """Return a callable that shows a controller engineer, once, the way to join.

        The text is made now, when there is no tick yet to hold up. Standard output is left to the
        summary where a program reads it.
        """
        left = [] if self.args.quiet else [introduction(self.config, self.bus, self.served)]
        stream = sys.stderr if self.args.json else sys.stdout

        def announce() -> None:
            while left:
                print(left.pop(), file=stream, flush=True)

        return announce

    def finish(
        self,
        ending: Ending,
        helpers: Helpers,
        lost: HilBenchError | None,
        lines: Iterable[str],
        content: Mapping[str, object],
    ) -> ExitCode:
        """Print the summary and the error that ended the run, and return the exit code."""
        with ending.going_on():
            print_results(self.args, lines, content)
        ending.take_error(lost)
        ending.take(self._recording_code(), helpers.code, self.wish.code)
        return ending.code

    def _recording_code(self) -> ExitCode:
        return recording_code(None if self.recording is None else self.recording.report)


@contextlib.contextmanager
def set_up(
    args: argparse.Namespace, config: BenchConfig, *, is_real_time: bool
) -> Iterator[RunSetup]:
    """Build the bench and open its recording, its buses, and what its parts serve.

    Args:
        args: the command line.
        config: of the bench.
        is_real_time: whether ticks must not wait for the recording.

    Yields:
        All that.
    """
    warn_of(find_doubts(config))
    with collection_put_off():
        session = open_session(config)
    with contextlib.ExitStack() as stack:
        stack.callback(session.door.close)
        wish = stack.enter_context(interruption())
        files = recording_wish(args)
        recording = stack.enter_context(recorded(session, files, config, is_real_time=is_real_time))
        bus = stack.enter_context(open_bus(args, config))
        served = []
        for part in config.parts:
            if isinstance(part, Serving):
                served.append(stack.enter_context(part.served(session, config)))
            else:
                stack.enter_context(part.attached(session, config))
        yield RunSetup(args, config, session, bus, served, recording, wish)


def introduction(config: BenchConfig, bus: OpenBus, served: Sequence[Served]) -> str:
    """Return the introduction of the bench for a controller engineer who joins."""
    source = config.path or "built-in bench"
    plant = f"{config.steps_per_tick} plant steps a tick" if config.axes else "no axis"
    rate = f"{1e9 / config.tick_ns:g} Hz, {plant}"
    lines = [f"bench  {source}, {rate}", *bus.lines]
    lines += [line for part in served for line in part.lines]
    lines += [line for part in config.parts for line in part.lines]
    lines += [f"fault  {fault_line(fault)}" for fault in config.faults]
    return "\n".join((*lines, "", device_table(config), ""))


def fault_line(fault: FaultConfig) -> str:
    """Describe a fault and its time."""
    lasts = "" if fault.duration is None else f", for {fault.duration:g} s"
    return f"{fault.kind} {fault.target} at {fault.at:g} s{lasts}"
