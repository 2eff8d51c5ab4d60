"""Lines now and then, and lines that nobody takes."""

import contextlib
import logging
import os

import pytest

from hil_bench.cli.patient_handler import PatientHandler
from hil_bench.cli.progress import PERIOD, Progress


def test_a_line_a_minute_of_the_machines_time():
    said, clock = [], [0]
    progress = Progress(said.append, lambda _now: ["x +1.00 mm", "in 3"], lambda: clock[0])
    for second in range(130):
        clock[0] = second * PERIOD // 60
        progress.look(second * 2_000_000_000)  # a bench at twice the speed
    assert said == ["120.000 s: x +1.00 mm  in 3", "240.000 s: x +1.00 mm  in 3"]


@pytest.fixture
def pipe():
    reader, writer = os.pipe()
    with open(writer, "w", encoding="utf-8") as stream:  # noqa: PTH123 - a descriptor
        yield reader, stream
    os.close(reader)


def test_a_line_that_nobody_takes_is_left_out_and_counted(pipe):
    reader, stream = pipe
    os.set_blocking(stream.fileno(), False)
    with contextlib.suppress(BlockingIOError):
        while os.write(stream.fileno(), b"." * 4096):
            pass
    os.set_blocking(stream.fileno(), True)  # now a write would wait for ever
    handler = PatientHandler()
    handler.setStream(stream)
    for number in range(3):
        handler.handle(logging.makeLogRecord({"msg": f"line {number}"}))
    os.set_blocking(reader, False)
    with contextlib.suppress(BlockingIOError):
        while b"line" not in os.read(reader, 65_536):
            pass
        pytest.fail("a line was written")
    handler.handle(logging.makeLogRecord({"msg": "line 3"}))
    assert os.read(reader, 100) == b"line 3 (3 lines before this one are lost)\n"


def test_a_line_that_can_be_taken_is_written(pipe):
    reader, stream = pipe
    handler = PatientHandler()
    handler.setStream(stream)
    handler.handle(logging.makeLogRecord({"msg": "all is %s", "args": ("well",)}))
    assert os.read(reader, 100) == b"all is well\n"
