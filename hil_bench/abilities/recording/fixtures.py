"""A recording of each test, where ``--hil-record`` asks for it: a plugin of pytest."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from hil_bench.abilities.common.pytest_options import add_options, path_option

if TYPE_CHECKING:
    from hil_bench.abilities.recording.report import RecordingReport
    from hil_drivers import Network

_OPTIONS = {
    "record": ("DIR", "record each test's signals and frames in a file of its own: DIR/TEST.mf4"),
}


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option, with an ini key of its name."""
    add_options(parser, _OPTIONS)


@contextmanager
def record_frames(network: "Network", item: pytest.Item) -> Iterator[None]:
    """Record what passes a physical bus, as the drivers see it, for the time of the block.

    Yields:
        Nothing.
    """
    path = make_recording_path(item)
    if path is None:
        yield
        return
    from hil_bench.abilities.recording.recorder import RecordingPlan
    from hil_bench.abilities.recording.recorder_process import RecorderProcess
    from hil_bench.abilities.recording.work import NetworkTap

    with RecorderProcess(RecordingPlan((path,), ())) as recording:
        network.observe = NetworkTap(recording, network.now).observe
        yield
    check_recorded(recording.report)


def check_recorded(report: "RecordingReport | None") -> None:
    """Refuse a recording, None for one that was not asked for, that is not complete.

    Raises:
        RecordingError: it says why.
    """
    if report is not None and not report.is_complete:
        from hil_bench.errors import RecordingError

        lost = f"{report.lost} messages left out, the recorder was too slow" if report.lost else ""
        raise RecordingError("; ".join(filter(None, [*report.problems, lost])))


def make_recording_path(item: pytest.Item) -> Path | None:
    """Return the path for the recording of a test, its folder made; None without `--hil-record`."""
    path = recording_path(item)
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
    return path


def recording_path(item: pytest.Item) -> Path | None:
    """Return the path of a test's recording; None without `--hil-record`."""
    folder = path_option(item.config, "record")
    if folder is None:
        return None
    return folder / f"{re.sub(r'[^A-Za-z0-9_.=-]+', '_', item.nodeid)}.mf4"


def files(item: pytest.Item) -> dict[str, Path]:
    """Return the recording of a test where there is one, by what it is."""
    path = recording_path(item)
    return {"recording": path} if path is not None and path.exists() else {}
