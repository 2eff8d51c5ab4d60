"""What the report of a failed test says of its bench."""

from collections.abc import Callable
from pathlib import Path

import pytest

from hil_bench.faults.faults import Faults
from hil_bench.pytest_plugin.artifacts import file_stem, write_artifacts
from hil_bench.pytest_plugin.firmware import FirmwareBus
from hil_bench.pytest_plugin.options import shown_path
from hil_bench.pytest_plugin.recording import recording_path
from hil_bench.virtual_bench import VirtualBench

SHOWN_FRAMES = 20
"""Frames that a failed test shows."""


def describe_bench(bench: VirtualBench, firmware: FirmwareBus | None) -> list[tuple[str, str]]:
    """Return the sections of the report: frames, and faults and firmware where there are some."""
    sections = [(f"last {SHOWN_FRAMES} frames on the bench's bus", _trace(bench))]
    if bench.faults.events:
        sections.append(("faults", _fault_events(bench.faults)))
    if firmware is not None:
        sections.append(("firmware", firmware.report()))
    return sections


def attach_files(
    item: pytest.Item,
    bench: VirtualBench,
    choose_directory: Callable[[], Path],
    report: pytest.TestReport,
) -> None:
    """Write what the bench of a test recorded, and say in its report where it is."""
    try:
        files = write_artifacts(bench, choose_directory(), file_stem(item.nodeid))
    except (OSError, ValueError) as error:
        report.sections.append(("hil-bench files", f"could not be written: {error}"))
        return
    shown = {what: shown_path(item.config, path) for what, path in files.items()}
    item.user_properties.extend((f"hil_{what}", path) for what, path in shown.items())
    recording = recording_path(item)
    if recording is not None and recording.exists():
        shown["recording"] = shown_path(item.config, recording)
    lines = [f"{what:9} {path}" for what, path in shown.items()]
    report.sections.append(("hil-bench files", "\n".join(lines)))


def _fault_events(faults: Faults) -> str:
    """Return which faults began and ended when."""
    return "\n".join(
        f"({time * 1e-9:.6f}) {kind} {target} {'begins' if is_begin else 'ends'}"
        for time, kind, target, is_begin in faults.events
    )


def _trace(bench: VirtualBench) -> str:
    """Return the latest frames as candump shows them, marked as seen from the bench."""
    return "\n".join(
        f"({now * 1e-9:.6f}) {f'can{frame.bus} ' if frame.bus else ''}"
        f"{frame.can_id:03X}#{frame.data.hex().upper()} "
        f"{'to' if is_received else 'from'} the bench"
        for frame, now, is_received in list(bench.frames)[-SHOWN_FRAMES:]
    )
