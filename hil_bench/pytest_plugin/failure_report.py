"""The bench's sections in the report of a failed test."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import cast

import pytest

from hil_bench.ability import load, own_abilities
from hil_bench.devices.faults.faults import Faults
from hil_bench.outside.recording.logged_frame import LoggedFrame
from hil_bench.pytest_plugin.artifacts import file_stem, write_artifacts
from hil_bench.pytest_plugin.options import shown_path
from hil_bench.pytest_plugin.recording import recording_path
from hil_bench.session.firmware import FirmwareBus
from hil_bench.session.virtual_bench import FrameReader, VirtualBench

SHOWN_FRAMES = 20
"""Frames that a failed test shows."""


def describe_bench(bench: VirtualBench, firmware: FirmwareBus | None) -> list[tuple[str, str]]:
    """Return the sections of the report that have something to say: frames, values, faults."""
    sections = [*_frames(bench), ("last values", _values(bench))]
    if bench.faults.events:
        sections.append(("faults", _fault_events(bench.faults)))
    if firmware is not None:
        sections.append(("firmware", firmware.report()))
    return [(title, text) for title, text in sections if text]


def _frames(bench: VirtualBench) -> Iterator[tuple[str, str]]:
    """Yield the sections about frames, where an ability reads them."""
    for ability in own_abilities():
        if ability.frame_reader:
            text = cast("Callable[[VirtualBench], FrameReader]", load(ability.frame_reader))(bench)
            frames = list(bench.frames)
            news = list(text.news(frames))[-SHOWN_FRAMES:]
            yield f"last {SHOWN_FRAMES} frames that are not cyclic", _trace(text, news)
            yield "last cyclic frames", _trace(text, list(text.latest(frames)))


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
    """List the begins and ends of faults with their times, a line each."""
    return "\n".join(
        f"({time * 1e-9:.6f}) {kind} {target} {'begins' if is_begin else 'ends'}"
        for time, kind, target, is_begin in faults.events
    )


def _trace(text: FrameReader, frames: Sequence[LoggedFrame]) -> str:
    """Return frames as candump shows them, with what they say in words."""
    return "\n".join(
        f"({now * 1e-9:.6f}) {f'can{frame.bus} ' if frame.bus else ''}"
        f"{f'{frame.can_id:03X}#{frame.data.hex().upper()}':20} {'to' if is_received else 'from'} "
        f"the bench  {text.name(frame)}{': ' * bool(text.meaning(frame))}{text.meaning(frame)}"
        for frame, now, is_received in frames
    )


def _values(bench: VirtualBench) -> str:
    """Return the last value of each signal, in its SI unit."""
    units = bench.signals.units
    return "\n".join(f"{name:28} {value:.6g} {units[name]}" for name, value in bench.values.items())
