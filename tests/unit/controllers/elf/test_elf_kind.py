"""Controllers of the kind `elf`: their table, the example as it is flashed, and its end."""

import os
import signal

import pytest
from support.chip_programs import CAN_BUILD, WHY_NOT, build_example, build_for_chip

from hil_bench import TimedFrame, VirtualBench, load_config
from hil_bench.abilities.controllers.elf import kind as elf_kind
from hil_bench.abilities.controllers.elf.controller import ElfController
from hil_bench.abilities.controllers.elf.job import Job
from hil_bench.abilities.controllers.elf.machine import Machine
from hil_bench.abilities.scenario.judgement import RequirementOutcome
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.run import play, prepare
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ConfigError, ControllerError, require_extra

MS = 1_000_000
HOST = "host"
CHIPS = {"stm32f4": "STM32F407", "stm32g4": "STM32G431"}

needs_compiler = pytest.mark.skipif(not CAN_BUILD, reason=WHY_NOT)


@pytest.mark.parametrize(
    ("table", "line"),
    [
        ('chip = "LPC1768"', 'chip: "LPC1768" is not known; known are STM32F042, '),
        ('chip = "STM32F407"\ncan = [3]', "can: STM32F407 has CAN controllers 1 to 2"),
        ('chip = "STM32F407"\ncan = [1, 1]', "can: [1, 1] has one twice; write them as [1] or"),
        ('chip = "STM32F407"\ncan = "1"', 'can: "1" is no list of CAN controllers; write them'),
        ('chip = "STM32F407"\ninstructions_per_ms = 10', "give an integer from 1000 to 1000000"),
        ('chip = "STM32F407"\njitter_us = -1', "give an integer from 0 to 10000"),
        ("", "chip: missing"),
    ],
)
def test_a_wrong_table_is_said_in_a_line(tmp_path, table, line):
    file = tmp_path / "bench.toml"
    file.write_text(f'[controllers.axis]\nkind = "elf"\nprogram = "axis.elf"\n{table}\n')
    with pytest.raises(ConfigError) as raised:
        load_config(file)
    assert line in str(raised.value)
    assert str(raised.value).startswith(f"{file}:controllers.axis")


def test_a_missing_simulator_is_named_with_its_extra():
    with pytest.raises(ConfigError, match=r"pip install 'hil-bench\[elf\]'"):
        require_extra("no_such_package", "this", "elf")
    assert elf_kind.KIND.name == "elf"


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The example for both chips, and for the host as a library."""
    folder = tmp_path_factory.mktemp("built")
    return build_example(folder, *(f"{name}.elf" for name in CHIPS), "libposition_control.so")


def drive(folder, name, seconds):
    """Return what the example has sent, on its chip or the host, and where the piston was."""
    file = folder / f"{name}.toml"
    table = f'kind = "elf"\nprogram = "{name}.elf"\nchip = "{CHIPS.get(name)}"\n'
    if name == HOST:
        table = 'kind = "library"\nlibrary = "libposition_control.so"\n'
        table += 'settings = { targets_mm = "50,-20" }\n'
    file.write_text(f"[bench]\ntick_us = 250\n[controllers.axis]\n{table}")
    frames: list[Frame] = []
    with VirtualBench(load_config(file)) as bench:
        bench.session.watch(frames=lambda received, _sent, _now: frames.extend(received))
        positions = []
        for _ in range(round(seconds * 100)):
            bench.run(0.01)
            positions.append(bench.values["axis1.position"])
    return frames, positions


@needs_compiler
@pytest.mark.long
@pytest.mark.parametrize("name", ["stm32f4", "stm32g4"])
def test_the_example_drives_from_its_chip(built, name):
    frames, positions = drive(built, name, 1.6)
    # Its targets are 50 and -20 mm, its own limit of error at rest is 0.1 mm.
    assert min(abs(position - 0.050) for position in positions) < 1e-4
    assert abs(positions[-1] + 0.020) < 1e-4
    again, _ = drive(built, name, 0.4)
    assert again == frames[: len(again)]
    assert len(again) > 100


@needs_compiler
def test_jitter_is_drawn_from_the_seed(built):
    """The chip answers a SYNC's TPDOs when they come: the same times with the same seed alone."""
    job = Job(built / "stm32f4.elf", "STM32F407", 20_000, 8_000_000, (1,), (0,))
    jobs = [job, *(job._replace(jitter_ns=400_000, seed=seed) for seed in ("1", "1", "2"))]
    still, first, again, other = map(boot_times, jobs)
    assert first == again
    assert len({*map(tuple, (still, first, other))}) == 3


def boot_times(job):
    """When a chip sends in its first 20 ms; two nodes say each millisecond that they boot."""
    machine, sent = Machine(job), list[TimedFrame]()
    for now in range(MS, 20 * MS, MS):
        sent += machine.advance(
            now, [TimedFrame(now - MS, Frame(0x700 + node, b"\0")) for node in (1, 4)]
        )
    return [time for time, _ in sent]


@needs_compiler
def test_the_chips_send_the_words_of_the_host(built):
    """SDO and NMT, whose content does not hang on when a frame came."""
    words = []
    for name in (HOST, *CHIPS):
        frames, _ = drive(built, name, 0.2)
        words.append(
            [frame for frame in frames if frame.can_id == 0 or 0x600 <= frame.can_id < 0x700]
        )
    assert words[0] == words[1] == words[2]
    assert len(words[0]) > 10


@needs_compiler
@pytest.mark.long
def test_power_off_and_on_begins_anew(built):
    file = built / "power.scenario.toml"
    (built / "power.toml").write_text("[bench]\ntick_us = 250\n")
    file.write_text("""
title = "Loses its power on its way"
bench = "power.toml"
duration_s = 2.5
[controller]
kind = "elf"
program = "stm32f4.elf"
chip = "STM32F407"
[[step]]
at_s = 0.3
firmware = "restart"
[[expect]]
id = "T-1"
that = "eventually abs(axis1.position + 20 mm) < 0.2 mm"
[[expect]]
id = "T-2"
that = "always from 0.3 s to 0.6 s axis1.position > 35 mm"
""")
    # At 0.3 s it is some 40 mm out, and goes on from there.
    for finding in play(prepare(load_scenario(file))).findings:
        assert finding.judgement.outcome is RequirementOutcome.PASSED


@needs_compiler
def test_a_killed_simulator_is_a_line_and_leaves_no_process(built):
    job = Job(built / "stm32f4.elf", "STM32F407", 20_000, 8_000_000, (1,), (0,))
    controller = ElfController(job, MS)
    pid = controller._process.pid
    # More than a message of the kernel holds.
    frames = [TimedFrame(0, Frame(0x701, b"\x05"))] * 20_000
    assert controller.advance(MS, frames) is not None
    os.kill(pid, signal.SIGKILL)
    with pytest.raises(ControllerError) as raised:
        controller.advance(2 * MS, ())
    assert str(raised.value) == "the simulator of stm32f4.elf has ended: killed by signal 9"
    controller.close()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


@needs_compiler
def test_what_it_prints_is_logged_and_a_fault_has_its_registers(tmp_path, caplog):
    source = 'void program(void) { say("hello"); R32(0x90000000) = 1; rest(); }'
    job = Job(build_for_chip(source, tmp_path), "STM32F407", 20_000, 8_000_000, (1,), (0,))
    controller = ElfController(job, MS)
    try:
        with caplog.at_level("INFO"), pytest.raises(ControllerError) as raised:
            controller.advance(MS, ())
    finally:
        controller.close()
    first, hello, registers = str(raised.value).splitlines()
    assert first.startswith("hard fault in program+0x")
    assert hello == "hello"
    assert "=90000000 " in registers
    assert caplog.messages[0] == "0.001 s: program.elf: hello"
