"""The fixture `controller`: a controller of any kind on the bench of a test."""

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from hil_bench.abilities.controllers import standstill

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from hil_bench.abilities.controllers.handle import Handle
    from hil_bench.bench.virtual_bench import VirtualBench


def pytest_configure() -> None:
    """Keep standard error for a controller that never comes back."""
    standstill.keep_errors()


def pytest_unconfigure() -> None:
    """Let go of it."""
    standstill.drop_errors()


@pytest.fixture
def controller(
    request: pytest.FixtureRequest, bench: "VirtualBench", tmp_path_factory: pytest.TempPathFactory
) -> "Iterator[Callable[..., Handle]]":
    """Puts a controller on the bench: ``controller("python", call="axis.py:control")``.

    The first argument is its kind, the others are keys of its table (docs/firmware.md), from whose
    values paths count from the file of the test. It lives while bench time passes, as in
    ``bench.run(1.0)``.
    """
    from hil_bench.abilities.controllers.handle import Handles  # a bench, and much with it

    folder = Path(request.path).parent
    handles = Handles(bench, folder, tmp_path_factory.mktemp("controllers"))
    yield handles.put
    handles.close()
