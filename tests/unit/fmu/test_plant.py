"""An FMU on a bench: bound to quantities, moved tick by tick, and what it says when it fails."""

import gc
import io
import signal
import struct
import subprocess
import sys
import tempfile
from dataclasses import replace

import pytest

from hil_bench.errors import ParameterError
from hil_bench.plants.fmu import child
from hil_bench.plants.fmu.configuration import FULL_SCALE, FmuBinding
from hil_bench.plants.fmu.slave import Setup

HUGE = (
    '{ position = "x", speed = "v", a = { variable = "v", unit = "1" }, '
    'b = { variable = "v", unit = "1" } }'
)
VERSIONS = pytest.mark.parametrize("version", [2, 3])


@VERSIONS
def test_moves_under_its_command(load, version):
    config = load(version)
    (axis,) = config.axes
    assert [(q.name, q.unit, q.output) for q in axis.kind.quantities] == [
        ("position", "m", 0),
        ("speed", "m/s", 1),
        ("spool_position", "-", 2),
        ("spool_setpoint", "-", None),
    ]
    plant = axis.kind.build(axis, config.dt)
    assert plant.output == (0.0, 0.0, 0.0)
    seen = plant.drive(0.4 * FULL_SCALE, 100)  # u = 40: 0.5 · 40 mm/s for 0.1 s
    assert seen == pytest.approx((2e-3, 20e-3, 0.4 * FULL_SCALE), rel=1e-9)


@VERSIONS
def test_takes_parameters_and_inputs(load, version):
    config = load(version, parameters="{ gain = 2, damping = 10 }")
    (axis,) = config.axes
    plant = axis.kind.build(axis, config.dt)
    (load_input,) = axis.influences
    assert (load_input.name, load_input.unit) == ("load", "N")
    plant.influence("load", 50.0)  # 50 / 10 mm/s backwards
    assert plant.drive(0.01 * FULL_SCALE, 1)[1] == pytest.approx((2.0 * 1.0 - 5.0) * 1e-3)
    plant.influence("load", None)
    assert plant.drive(0.01 * FULL_SCALE, 1)[1] == pytest.approx(2e-3)
    kilonewtons = replace(axis, inputs={"load": FmuBinding(0, factor=1e3, start=2.5)})
    assert kilonewtons.influences[0].usual == 2500.0


def test_a_variable_may_be_in_another_unit_than_it_says(load):
    config = load(
        outputs='{ position = { variable = "x", unit = "um" }, speed = "v", spool_position = "v" }'
    )
    (axis,) = config.axes
    plant = axis.kind.build(axis, config.dt)
    seen = plant.drive(0.4 * FULL_SCALE, 100)
    assert seen == pytest.approx((2e-6, 20e-3, 0.2 * FULL_SCALE))  # v = 20 of 100


def test_the_encoder_knows_the_range_that_the_fmu_declares(load):
    (axis,) = load().axes
    assert axis.limits("position") == pytest.approx((-0.1, 0.1))


@VERSIONS
def test_a_step_that_fails_ends_in_one_line(load, version):
    config = load(version, parameters="{ fails_at = 0.05 }")
    (axis,) = config.axes
    plant = axis.kind.build(axis, config.dt)
    plant.drive(0.0, 40)
    with pytest.raises(ParameterError) as caught:
        plant.drive(0.0, 20)
    assert str(caught.value) == (
        f"plant.axis1: {config.path.parent / 'slider.fmu'}: at 0.04 s: "
        f"fmi{version}DoStep failed with status 3 (error): the slider has left its rail"
    )


@VERSIONS
def test_what_is_no_number_ends_in_one_line(load, version):
    config = load(version, parameters="{ breaks_at = 0.05 }")
    (axis,) = config.axes
    plant = axis.kind.build(axis, config.dt)
    with pytest.raises(
        ParameterError, match=r"at 0.05 s: position is nan; a finite number is right"
    ):
        plant.drive(0.0, 50)


def test_in_the_process_of_the_bench_it_moves_just_so(load):
    moved = []
    for own_process in ("true", "false"):
        (axis,) = (config := load(own_process=own_process, parameters="{ gain = 0.3 }")).axes
        plant = axis.kind.build(axis, config.dt)
        plant.influence("load", 1.7)
        moved.append([plant.drive(0.1 * n * FULL_SCALE, 7) for n in range(9)])
    assert moved[0] == moved[1]


def test_a_crash_ends_in_one_line(load, capfd):
    config = load(parameters="{ crashes_at = 0.05 }")
    (axis,) = config.axes
    plant = axis.kind.build(axis, config.dt)
    plant.drive(0.0, 40)
    with pytest.raises(ParameterError, match=r"slider.fmu: at 0.04 s: has crashed: SIGSEGV$"):
        plant.drive(0.0, 20)
    shown = capfd.readouterr()
    assert shown.out == ""
    assert "the slider is about to crash" in shown.err  # on its way to people, not among answers


def test_a_step_that_never_returns_ends_in_one_line(load, monkeypatch):
    monkeypatch.setattr("hil_bench.plants.fmu.child._LONGEST_STEP_S", 0.01)
    config = load(parameters="{ hangs_at = 0.0 }")
    (axis,) = config.axes
    plant = axis.kind.build(axis, config.dt)
    with pytest.raises(ParameterError, match=r"at 0 s: has not answered for 0.01 s$"):
        plant.drive(0.0, 1)


@pytest.mark.parametrize("own_process", ["true", "false"])
def test_a_refused_instance_is_one_line(load, own_process):
    from support.fmus import describe_2  # noqa: PLC0415

    description = describe_2().replace("{slider}", "{other}")
    config = load(description=description, own_process=own_process)
    (axis,) = config.axes
    with pytest.raises(ParameterError, match=r"Failed to instantiate model$"):
        axis.kind.build(axis, config.dt)


def test_leaves_no_folder_behind(load, tmp_path, monkeypatch):
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    config = load()
    (axis,) = config.axes
    plant = axis.kind.build(axis, config.dt)
    assert len(list(folder.iterdir())) == 1
    del plant
    gc.collect()
    assert list(folder.iterdir()) == []


@pytest.mark.long  # a process starts
def test_a_child_without_a_bench_ends_without_a_word():
    """The bench was killed before it sent the setup, or half of it."""
    for sent in (b"", b'[2, "token'):
        done = subprocess.run(  # noqa: S603 - our own program
            [sys.executable, "-m", child.__name__], input=sent, capture_output=True, check=True
        )
        assert (done.stdout, done.stderr) == (b"", b"")


class Surprised:
    """An instance that fails in a way that nobody has foreseen."""

    values = (1.0,)

    def __init__(self, _setup):
        self.is_ended = False

    def go_on(self, _given, _steps):
        raise OverflowError("intermediate overflow in fsum")

    def end(self):
        self.is_ended = True


def test_an_error_in_a_child_is_an_answer(monkeypatch):
    monkeypatch.setattr(child, "Instance", Surprised)
    setup = Setup(2, "t", "i", "", "", "axis1", 1e-4, (), [1], [0.0], [2])
    answers = io.BytesIO()
    child.serve(setup, io.BytesIO(struct.pack("=Id", 1, 0.5)), answers)
    good = struct.pack("=?Hd", False, 0, 1.0)
    reason = b"OverflowError: intermediate overflow in fsum"
    assert answers.getvalue() == good + struct.pack("=?H", True, len(reason)) + reason


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="Windows has no signal masks")
def test_a_child_never_hears_ctrl_c(monkeypatch):
    masks = []

    class RefusedError(Exception):
        pass

    def popen(*_, **__):
        masks.append(signal.pthread_sigmask(signal.SIG_BLOCK, ()))
        raise RefusedError

    monkeypatch.setattr(subprocess, "Popen", popen)
    with pytest.raises(RefusedError):
        child.Child(Setup(2, "t", "i", "", "", "axis1", 1e-4, (), [1], [0.0], [2]))
    assert signal.SIGINT in masks[0]
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_outputs_whose_sum_is_no_number_are_numbers(load):
    """Each is below the largest double, 1.8e308; x' = 1e306 · 100 mm/s, so v = 1e308 mm/s."""
    config = load(parameters="{ gain = 1e306 }", outputs=HUGE)
    (axis,) = config.axes
    plant = axis.kind.build(axis, config.dt)
    seen = plant.drive(FULL_SCALE, 1)
    assert seen[2:4] == pytest.approx((1e308, 1e308))
