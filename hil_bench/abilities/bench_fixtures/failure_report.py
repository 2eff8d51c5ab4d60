"""The bench's sections in the report of a failed test."""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import cast

import pytest

from hil_bench.abilities.common.block_file import CandumpFile, RecordingFile
from hil_bench.abilities.common.pytest_options import shown_path
from hil_bench.ability import given_to, load, own_abilities
from hil_bench.bench.bench import Event
from hil_bench.bench.events import event_spans, event_text
from hil_bench.bench.virtual_bench import FrameReader, VirtualBench
from hil_bench.outside.recording.channels import LoggedFrame

# Artifacts of a failed test: its bus trace, its signals and their plot.

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
    with CandumpFile(files["trace"]) as trace:
        trace.write_frames(tuple(bench.frames))
    with RecordingFile(files["signals"]) as signals:
        signals.write(bench.signals)
    picture, spans = directory / f"{stem}.png", event_spans(bench.bench, bench.now())
    for module in given_to("picture"):
        if module.draw_motion(bench.signals, picture, title=stem, spans=spans):
            files["plot"] = picture
    return files


SHOWN_FRAMES = 20
"""Frames that a failed test shows."""


def describe_bench(bench: VirtualBench) -> list[tuple[str, str]]:
    """Return the sections of the report that have something to say: frames, values, events."""
    sections = [*_frames(bench), ("last values", _values(bench))]
    sections += [(name, _events(log)) for name, log in bench.bench.events.items()]
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
    for module in given_to("pytest"):
        found = module.files(item)
        shown |= {what: shown_path(item.config, path) for what, path in found.items()}
    lines = [f"{what:9} {path}" for what, path in shown.items()]
    report.sections.append(("hil-bench files", "\n".join(lines)))


def _events(log: Iterable[Event]) -> str:
    """List begins and ends, as those of faults, with their times, a line each."""
    return "\n".join(f"({event.time * 1e-9:.6f}) {event_text(event)}" for event in log)


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
