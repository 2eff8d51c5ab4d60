"""Programs on the bus of a bench: started, served, heard and ended.

The programs are small scripts that speak the socketcand protocol over a bare socket.
"""

import signal
import sys

import pytest
from support.bus_programs import JOIN

from hil_bench.abilities.lockstep.firmware import HUB, FirmwareBus
from hil_bench.bench.virtual_bench import VirtualBench
from hil_bench.errors import ControllerError, WaitTimeoutError


@pytest.fixture
def bench():
    with VirtualBench() as bench:
        yield bench


@pytest.fixture
def bus(bench):
    bus = FirmwareBus(bench, HUB, is_realtime=False)
    yield bus
    bus.close()


@pytest.fixture
def start(bus, tmp_path):
    return lambda script, *words: bus.start([sys.executable, "-c", JOIN + script, *words], tmp_path)


def test_its_syncs_are_the_benchs_time(bench, start):
    program = start("sync(25); sys.exit(7)")
    assert program.wait(timeout=1.0) == 7
    assert bench.now() == pytest.approx(0.025)
    assert bench.signals["time"] == pytest.approx([k * 1e-3 for k in range(26)])


def test_the_bench_runs_until_a_condition_holds_and_no_further(bench, start):
    start("while True: sync(10)")
    took = bench.run_until(lambda: bench.now() > 0.0325, timeout=1.0)
    assert took == pytest.approx(0.033)
    bench.run(0.004)
    assert bench.now() == pytest.approx(0.037)


def test_a_wait_in_bench_time_ends(start):
    program = start("print('on my way', flush=True)\nwhile True: sync(10)")
    with pytest.raises(
        WaitTimeoutError, match=r"(?s)^not ended within 0\.05 s .*: runs\non my way$"
    ):
        program.wait(timeout=0.05)


def test_the_bus_stands_in_its_arguments_and_its_environment(bus, start):
    script = "print(sys.argv[1], os.environ['CAN_INTERFACE'], os.environ['CAN_CONFIG'])"
    program = start(script, "--bus={bus}")
    assert program.wait(timeout=1.0) == 0
    port = bus.address.removeprefix("127.0.0.1:")
    expected = f'--bus={bus.address} socketcand {{"host": "127.0.0.1", "port": {port}}}\n'
    assert program.stdout == expected


def test_a_program_that_ended_is_told_with_its_output_where_time_should_pass(bench, start):
    program = start("sync(5); sys.exit('no oil')")
    with pytest.raises(ControllerError, match=r"(?s)has ended, exit code 1\nno oil$"):
        bench.run(0.1)
    assert program.stderr == "no oil\n"
    assert bench.now() == pytest.approx(0.005)


STOPS_IN_ORDER = """
def stop(*_):
    sync(3)  # needs the bench while it ends
    print("safe")
    sys.exit(0)
signal.signal(signal.SIGTERM, stop)
sync(10)
print("ready", flush=True)
while True: signal.pause()
"""


def test_it_is_served_while_it_ends(bench, start):
    program = start(STOPS_IN_ORDER)
    bench.run(0.010)
    while "ready" not in program.stdout:
        program.link.step()
    assert program.stop() == 0
    assert program.stdout == "ready\nsafe\n"
    assert bench.now() == pytest.approx(0.013)
    assert program.stop() == 0  # a second time does nothing


def test_one_that_does_not_end_is_killed(bench, start):
    program = start("signal.signal(signal.SIGTERM, signal.SIG_IGN); sync(10); signal.pause()")
    bench.run(0.010)
    assert program.stop(grace=0.2) == -signal.SIGKILL


def test_a_program_that_is_not_there_is_an_error_of_the_test(bus, tmp_path):
    with pytest.raises(ControllerError, match=r"no_such_program: cannot be started: .*the PATH$"):
        bus.start(["no_such_program"], tmp_path)


def test_in_real_time_the_clock_lets_time_pass_whatever_the_program_does(bench, tmp_path):
    bus = FirmwareBus(bench, HUB, is_realtime=True)
    try:
        program = bus.start([sys.executable, "-c", JOIN + "sync(1)"], tmp_path)
        assert program.wait(timeout=50.0) == 0
        before = bench.now()
        bench.run(0.02)
        assert bench.now() >= before + 0.02 - 1e-9
    finally:
        bus.close()
