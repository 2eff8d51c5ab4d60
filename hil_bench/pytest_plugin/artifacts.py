"""Artifacts of a failed test: its bus trace, its signals and their plot."""

import re
from importlib.util import find_spec
from pathlib import Path

from hil_bench.outside.recording.files import RecordingFile
from hil_bench.outside.recording.frames import open_frame_file
from hil_bench.outside.recording.plot import has_axis, plot_result
from hil_bench.session.virtual_bench import VirtualBench, fault_spans

_UNSAFE = re.compile(r"[^A-Za-z0-9_.-]+")


def file_stem(node_id: str) -> str:
    """Return a file name for a test, such as ``test_axis.py-test_holds-50``."""
    return _UNSAFE.sub("-", node_id).strip("-.")[-120:]


def write_artifacts(bench: VirtualBench, directory: Path, stem: str) -> dict[str, Path]:
    """Write what a bench recorded; return the files by what they are.

    Args:
        bench: the bench of the test.
        directory: where to; it is made where it is not there yet.
        stem: the files' name without suffix.
    """
    directory.mkdir(parents=True, exist_ok=True)
    files = {"trace": directory / f"{stem}.log", "signals": directory / f"{stem}.csv"}
    with open_frame_file(files["trace"]) as trace:
        trace.write_frames(tuple(bench.frames))
    with RecordingFile(files["signals"]) as signals:
        signals.write(bench.signals)
    if find_spec("matplotlib") is not None and bench.signals.size and has_axis(bench.signals):
        files["plot"] = directory / f"{stem}.png"
        plot_result(bench.signals, files["plot"], title=stem, spans=fault_spans(bench))
    return files
