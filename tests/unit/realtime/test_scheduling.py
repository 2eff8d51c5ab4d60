import errno
import gc
import logging
import signal

import pytest

from hil_bench.bench.configuration import RealtimeConfig, RealtimePolicy
from hil_bench.outside.realtime.scheduling import undisturbed, undisturbed_by_garbage_collection


@pytest.fixture(autouse=True)
def _collector_as_before():
    was_enabled = gc.isenabled()
    yield
    if was_enabled:
        gc.enable()
    else:
        gc.disable()


@pytest.fixture
def collections(monkeypatch):
    """How much was set aside at each collection. All that conftest.py sets aside is back."""
    counts = []
    monkeypatch.setattr(gc, "collect", lambda: counts.append(gc.get_freeze_count()))
    gc.unfreeze()
    yield counts
    gc.freeze()


def test_the_collector_is_off_inside_and_on_again_after(collections):
    gc.enable()
    with undisturbed_by_garbage_collection():
        assert not gc.isenabled()
        assert gc.get_freeze_count() > 0
    assert collections == [0]
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0


def test_what_the_caller_has_set_aside_stays_so():
    gc.freeze()
    count = gc.get_freeze_count()
    with undisturbed_by_garbage_collection():
        kept = [[]]
    # Only what was freed meanwhile is gone; before, all came back to the collector.
    assert count // 2 < gc.get_freeze_count() <= count
    assert kept


def test_a_collector_that_was_off_stays_off():
    gc.disable()
    with undisturbed_by_garbage_collection():
        pass
    assert not gc.isenabled()


def test_the_collector_is_on_again_after_an_error():
    gc.enable()
    with pytest.raises(KeyError), undisturbed_by_garbage_collection():
        raise KeyError
    assert gc.isenabled()


class Kernel:
    """Keeps what is asked of it; refuses the calls named in `refused`."""

    def __init__(self, refused=()):
        self.refused = refused
        self.calls = []

    def __getattr__(self, name):
        def call(*arguments):
            if name in self.refused:
                raise OSError(errno.EPERM, "Operation not permitted")
            self.calls.append((name, *arguments))
            return {
                "timer_slack": 50_000,
                "processors": {0, 1, 2},
                "policy_restorer": lambda: self.calls.append(("restored",)),
                "limit_spinning": lambda: self.calls.append(("lifted",)),
                "hold_wake_latency": lambda: self.calls.append(("let sleep",)),
            }.get(name)

        return call


@pytest.fixture
def make_kernel(monkeypatch):
    """A kernel in place of this machine's."""

    def make(*refused, may_lock=True):
        kernel = Kernel(refused)
        monkeypatch.setattr("hil_bench.outside.realtime.scheduling.linux", kernel)
        monkeypatch.setattr(
            "hil_bench.outside.realtime.scheduling.may_lock_memory", lambda: may_lock
        )
        monkeypatch.setattr("hil_bench.outside.realtime.scheduling.IS_LINUX", True)
        return kernel

    return make


FIFO = RealtimeConfig(policy=RealtimePolicy.FIFO, priority=70, cpu=2)


def asked_for(kernel):
    """What was asked of the kernel that changes something."""
    questions = {"timer_slack", "processors", "policy_restorer"}
    return [call for call in kernel.calls if call[0] not in questions]


def test_without_a_policy_nothing_is_asked_for_that_needs_permission(make_kernel):
    kernel = make_kernel()
    with undisturbed(RealtimeConfig(), 1_000_000):
        assert asked_for(kernel) == [("set_timer_slack", 1)]
        assert not gc.isenabled()
    assert asked_for(kernel)[1:] == [("set_timer_slack", 50_000)]


def test_a_policy_is_taken_last_and_given_back_first(make_kernel):
    kernel = make_kernel()
    watch = signal.getsignal(signal.SIGXCPU)
    with undisturbed(FIFO, 1_000_000):
        assert asked_for(kernel) == [
            ("set_timer_slack", 1),
            ("set_processors", {2}),
            ("lock_memory",),
            ("hold_wake_latency",),
            ("limit_spinning", 1.0, 5.0),
            ("set_fifo_policy", 70),
        ]
        assert signal.getsignal(signal.SIGXCPU) is not watch
    assert asked_for(kernel)[6:] == [
        ("restored",),
        ("lifted",),
        ("let sleep",),
        ("unlock_memory",),
        ("set_processors", {0, 1, 2}),
        ("set_timer_slack", 50_000),
    ]
    assert signal.getsignal(signal.SIGXCPU) is watch


def test_what_is_held_is_named(make_kernel):
    make_kernel()
    with undisturbed(FIFO, 1_000_000) as held:
        assert held == ["processor 2", "memory", "wake-up latency 0 us", "SCHED_FIFO 70"]
    with undisturbed(RealtimeConfig(), 1_000_000) as held:
        assert held == []


def test_what_is_refused_is_not_held(make_kernel):
    make_kernel("hold_wake_latency", "lock_memory")
    with undisturbed(RealtimeConfig(policy=RealtimePolicy.DEADLINE), 1_000_000) as held:
        assert held == ["SCHED_DEADLINE"]


def test_a_deadline_policy_reserves_half_of_each_period(make_kernel):
    kernel = make_kernel()
    with undisturbed(RealtimeConfig(policy=RealtimePolicy.DEADLINE), 2_000_000):
        assert kernel.calls[-1] == ("set_deadline_policy", 1_000_000, 2_000_000)


@pytest.mark.parametrize(
    ("refused", "config", "warning"),
    [
        ("set_processors", FIFO, "loop not tied to processor 2; this process may use 0-2"),
        (
            "set_fifo_policy",
            FIFO,
            (
                "no SCHED_FIFO with priority 70; grant CAP_SYS_NICE, or 'rtprio 95' in "
                "/etc/security/limits.conf; in a container '--cap-add SYS_NICE'"
            ),
        ),
        (
            "set_deadline_policy",
            RealtimeConfig(policy=RealtimePolicy.DEADLINE),
            (
                "no SCHED_DEADLINE; grant CAP_SYS_NICE and all processors (no taskset, no cpuset), "
                "or take fifo; in a container '--cap-add SYS_NICE'"
            ),
        ),
        (
            "hold_wake_latency",
            FIFO,
            (
                "processors not kept awake; make /dev/cpu_dma_latency writable for this user by a "
                "udev rule; in a container '--device /dev/cpu_dma_latency'"
            ),
        ),
        (
            "lock_memory",
            FIFO,
            (
                "memory not locked; grant CAP_IPC_LOCK, or 'memlock unlimited' in "
                "/etc/security/limits.conf; in a container '--ulimit memlock=-1'"
            ),
        ),
    ],
)
def test_what_is_refused_is_one_warning_and_the_rest_is_taken(
    make_kernel, caplog, refused, config, warning
):
    kernel = make_kernel(refused)
    with undisturbed(config, 1_000_000):
        pass
    assert caplog.messages == [warning]
    wanted = {"set_processors", "set_fifo_policy", "lock_memory"} - {refused}
    assert config is not FIFO or wanted <= {call[0] for call in kernel.calls}


def test_memory_is_not_locked_below_a_limit(make_kernel, caplog):
    kernel = make_kernel(may_lock=False)
    with undisturbed(FIFO, 1_000_000):
        assert ("lock_memory",) not in kernel.calls
    assert caplog.messages[0].startswith("memory not locked; ")


def test_elsewhere_the_loop_runs_without_it(make_kernel, monkeypatch, caplog):
    everything = ("timer_slack", "processors", "set_processors", "lock_memory", "policy_restorer")
    make_kernel(*everything, "limit_spinning", "hold_wake_latency")
    monkeypatch.setattr("hil_bench.outside.realtime.scheduling.IS_LINUX", False)
    with undisturbed(FIFO, 1_000_000):
        pass
    assert caplog.messages == [
        "loop not tied to processor 2; this is there on Linux only",
        "memory not locked; this is there on Linux only",
        "processors not kept awake; this is there on Linux only",
        "no SCHED_FIFO with priority 70; this is there on Linux only",
    ]


def test_a_loop_that_spins_gets_its_normal_priority_back(make_kernel, caplog):
    kernel = make_kernel()
    with undisturbed(FIFO, 1_000_000), caplog.at_level(logging.WARNING):
        signal.raise_signal(signal.SIGXCPU)
        assert kernel.calls[-1] == ("set_normal_policy",)
    assert caplog.messages[0].startswith("the loop ran for 1 s without waiting: it goes on at ")
