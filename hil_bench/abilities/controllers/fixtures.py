"""The fixture `controller`: a controller of any kind on the bench of a test."""

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from hil_bench.abilities.controllers.handle import Handle
    from hil_bench.bench.virtual_bench import VirtualBench


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
