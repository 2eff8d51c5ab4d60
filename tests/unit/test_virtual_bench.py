"""The traces of a bench in virtual time."""

import math

import can
import pytest

from hil_bench.bench.virtual_bench import LoggedFrame, VirtualBench
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import WaitTimeoutError
from hil_bench.outside.realtime.clock import VirtualClock
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.recording.channels import Channel, recording_channels

READ_DEVICE_TYPE = can.Message(
    arbitration_id=0x604, data=bytes.fromhex("4000100000000000"), is_extended_id=False
)


def test_stimuli_are_recorded_beside_the_plant():
    force = Channel("force", "N")
    with VirtualBench(stimuli={force: lambda time: 3.0 * time}) as bench:
        bench.run(0.01)
        signals = bench.signals
    assert recording_channels(signals)[:2] == (Channel("time", "s"), force)
    assert signals["force"] == pytest.approx(3.0 * signals["time"])


def test_signals_reach_back_as_far_as_asked():
    with VirtualBench(recorded_time=0.005) as bench:
        bench.run(0.02)
        assert bench.signals["time"] == pytest.approx([0.016, 0.017, 0.018, 0.019, 0.020])


def test_a_bench_that_records_no_time_keeps_no_signals():
    with VirtualBench(recorded_time=0) as bench:
        bench.run(0.005)
        assert len(bench.signals) == 0
        assert bench.values == {}


def test_a_time_that_is_none_is_refused():
    with VirtualBench() as bench:
        for duration in (-1.0, math.nan, math.inf):
            with pytest.raises(ValueError, match="give a finite time, 0 or more"):
                bench.run(duration)
        for timeout in (-1.0, math.nan):
            with pytest.raises(ValueError, match="give a time, 0 or more"):
                bench.run_until(lambda: True, timeout=timeout)
        assert bench.now() == 0.0


def test_a_wait_lasts_until_its_condition_and_no_longer_than_its_time():
    with VirtualBench() as bench:
        assert bench.run_until(lambda: True, timeout=0.0) == 0.0
        waited = bench.run_until(lambda: bench.now() > 0.0025, timeout=0.003)
        assert waited == pytest.approx(0.003)  # the third tick of 1 ms
        with pytest.raises(WaitTimeoutError, match=r"condition not met within 0.002 s of bench"):
            bench.run_until(lambda: False, timeout=0.002)
        assert bench.now() == pytest.approx(0.005)


def test_observers_hear_of_each_tick():
    times = []
    with VirtualBench() as bench:
        bench.observers.append(times.append)
        bench.run(0.003)
    assert times == pytest.approx([0.001, 0.002, 0.003])


def test_frames_are_logged_both_ways():
    with VirtualBench(logged_frames=2) as bench:
        bench.run(0.001)
        bench.bus.send(READ_DEVICE_TYPE)
        bench.run(0.001)
        request, answer = bench.frames
    assert request == LoggedFrame(
        Frame(0x604, bytes.fromhex("4000100000000000")), 2_000_000, is_received=True
    )
    # Expedited answer; the device type's low word is the profile, 406 = 0x0196.
    assert answer.frame.can_id == 0x584
    assert answer.frame.data[:6] == bytes.fromhex("430010009601")
    assert not answer.is_received


def test_a_pacer_holds_each_tick():
    pacer = Pacer(VirtualClock(), 1_000_000)
    with VirtualBench(pacer=pacer) as bench:
        bench.run(0.02)
    assert pacer.statistics.ticks == 20
