"""What is said and done about processes beside a loop that end, by a clock of the test's."""

import threading

import pytest

from hil_bench.abilities.hub.hosting import HubHelper
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.helpers import DELAYS, LOOK, SOUND, Helpers
from hil_bench.errors import BusError

SECOND = 1_000_000_000
KILLED = "was killed (SIGKILL, by somebody or for want of memory)"


class FakeHelper:
    name, loss = "server", "its clients are cut off"

    def __init__(self, *, is_needed=True):
        self.is_needed = is_needed
        self.end = None
        self.starts = 0
        self.problem = None
        self.threads = set()

    def ending(self):
        return self.end

    def restart(self):
        self.starts += 1
        self.threads.add(threading.current_thread())
        if self.problem is not None:
            raise self.problem
        self.end = None
        return "TCP 127.0.0.1:5020"


class Bed:
    """Helpers and their clock."""

    def __init__(self, *helpers, **options):
        self.now = 0
        self.looks = 0
        self.helpers = Helpers(helpers, clock=lambda: self.now, **options)

    def pass_time(self, seconds):
        """Let time pass, a look after another; each start is waited for."""
        end = self.now + round(seconds * SECOND)
        while self.now < end:
            self.now += LOOK
            self.helpers.look()
            self.helpers.close()


@pytest.fixture(autouse=True)
def _all_levels(caplog):
    caplog.set_level("WARNING")


def test_a_death_is_said_at_the_next_look_and_mended_by_another_thread(caplog):
    helper = FakeHelper()
    bed = Bed(helper)
    bed.pass_time(1.0)
    assert caplog.messages == []
    helper.end = KILLED
    bed.pass_time(0.1)
    (said,) = caplog.messages
    assert said == (
        f"server: its process {KILLED}; its clients are cut off; the run goes on, and a new start "
        "follows in 0.5 s"
    )
    assert bed.helpers.code is ExitCode.LOST
    bed.pass_time(0.4)
    assert helper.starts == 0
    bed.pass_time(0.2)
    assert helper.starts == 1
    assert caplog.messages[1:] == ["server: runs again (TCP 127.0.0.1:5020)"]
    assert threading.current_thread() not in helper.threads
    assert bed.helpers.code is ExitCode.DONE
    assert not bed.helpers.is_over
    assert bed.helpers.lines() == [f"server ended once, last: {KILLED}; runs again"]


def test_one_that_dies_again_and_again_is_given_up(caplog):
    helper = FakeHelper()
    bed = Bed(helper)
    for delay in DELAYS:
        helper.end = KILLED
        bed.pass_time(delay + 0.3)
    assert helper.starts == len(DELAYS)
    helper.end = KILLED
    bed.pass_time(100.0)
    assert helper.starts == len(DELAYS)
    assert caplog.messages[-1] == (
        f"server: its process {KILLED}; its clients are cut off; given up after 5 new starts; "
        "the run goes on without"
    )
    assert bed.helpers.code is ExitCode.LOST
    assert bed.helpers.lines() == [f"server ended 6 times, last: {KILLED}; does not run any more"]


def test_one_that_was_sound_for_a_minute_begins_anew(caplog):
    helper = FakeHelper()
    bed = Bed(helper)
    for _ in range(2 * len(DELAYS)):
        helper.end = KILLED
        bed.pass_time(DELAYS[0] + 0.3)
        bed.pass_time(SOUND / SECOND)
    assert helper.starts == 2 * len(DELAYS)
    assert all("given up" not in message for message in caplog.messages)


@pytest.mark.parametrize(
    ("problem", "said"),
    [
        (BusError("modbus 127.0.0.1:5020: the port is in use"), "the port is in use"),
        (OSError(12, "Cannot allocate memory"), "Cannot allocate memory"),
    ],
)
def test_a_start_that_fails_is_said_and_tried_again(caplog, problem, said):
    helper = FakeHelper()
    bed = Bed(helper)
    helper.end, helper.problem = KILLED, problem
    bed.pass_time(0.8)
    assert "server: cannot be started again: " in caplog.messages[-1]
    assert said in caplog.messages[-1]
    assert caplog.messages[-1].endswith("a new start follows in 1 s")
    helper.problem = None
    bed.pass_time(1.3)
    assert caplog.messages[-1] == "server: runs again (TCP 127.0.0.1:5020)"


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_an_error_of_ours_in_a_start_is_no_success(caplog):
    helper = FakeHelper()
    bed = Bed(helper)
    helper.end, helper.problem = KILLED, ZeroDivisionError("a bug")
    bed.pass_time(0.8)
    assert "cannot be started again: an error of hil-bench; " in caplog.messages[-1]
    assert bed.helpers.code is ExitCode.LOST


@pytest.mark.parametrize("is_needed", [True, False])
def test_the_run_ends_with_it_where_that_is_wanted(caplog, is_needed):
    helper = FakeHelper(is_needed=is_needed)
    bed = Bed(helper, ends_on_loss=True)
    bed.pass_time(1.0)
    assert not bed.helpers.is_over
    helper.end = KILLED
    bed.pass_time(20.0)
    assert bed.helpers.is_over
    assert bed.helpers.code is ExitCode.LOST
    assert helper.starts == 0
    (said,) = caplog.records
    assert said.getMessage().endswith("the run ends (--end-on-loss)")
    assert said.levelname == ("ERROR" if is_needed else "WARNING")


def test_one_that_is_not_needed_leaves_the_run_complete():
    helper = FakeHelper(is_needed=False)
    bed = Bed(helper)
    helper.end, helper.problem = KILLED, BusError("no")
    bed.pass_time(60.0)
    assert bed.helpers.code is ExitCode.DONE


@pytest.mark.parametrize("ends_on_loss", [True, False])
def test_a_lost_recording_ends_the_run_where_that_is_wanted(ends_on_loss):
    lost = []
    bed = Bed(ends_on_loss=ends_on_loss, has_lost_data=lambda: bool(lost))
    bed.pass_time(1.0)
    assert not bed.helpers.is_over
    lost.append(True)
    bed.pass_time(0.1)
    assert bed.helpers.is_over is ends_on_loss


def test_it_looks_ten_times_a_second_however_often_it_is_asked():
    class Counted(FakeHelper):
        looks = 0

        def ending(self):
            self.looks += 1

    helper = Counted()
    bed = Bed(helper)
    for _ in range(1000):  # ticks of 1 ms
        bed.helpers.look()
        bed.now += 1_000_000
    assert helper.looks == 10


class FakeHub:
    host, port = "localhost", 29536

    def __init__(self, ending):
        self.done, self._ending = [], ending

    def ending(self):
        return self._ending

    def restart(self):
        self.done.append("restart")


class FakeEnd:
    def __init__(self, hub, name, *, is_down):
        self._done, self._name, self.is_down = hub.done, name, is_down

    def drop(self):
        self._done.append(f"drop {self._name}")
        self.is_down = True

    def join(self):
        self._done.append(f"join {self._name}")


@pytest.mark.parametrize(
    ("ended", "down", "said", "done"),
    [
        (None, (), None, []),
        (None, ("b",), "has cut off the bench, which was too slow for it", ["join b"]),
        ("killed", (), "killed", ["drop a", "drop b", "restart", "join a", "join b"]),
    ],
)
def test_a_hub_is_started_again_only_where_it_has_ended(ended, down, said, done):
    hub = FakeHub(ended)
    helper = HubHelper(hub, [FakeEnd(hub, name, is_down=name in down) for name in "ab"])
    assert helper.name == "hub localhost:29536"
    assert helper.ending() == said
    assert helper.restart() == ""
    assert hub.done == done
