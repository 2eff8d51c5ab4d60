"""The one place that decides whether the plant's kernels are compiled.

A kernel is a plain function on floats. Where Numba is installed it is compiled to machine code;
where it is not, or where `NUMBA_DISABLE_JIT=1`, the very same source runs as Python.

`fastmath` stays off: without it the compiled kernel does the same IEEE operations in the same order
as the interpreted one, so both give the same bits, and NaN and infinity keep their meaning.
Numba is imported, and a kernel compiled, when the first plant is built: what builds none, as
`hil-bench check`, starts without it. The machine code is cached on disk. Numba sees a change of
the file that holds a kernel, but not of a file that this kernel calls into: so each state of the
plants' sources has a cache of its own.
"""

import functools
import hashlib
import importlib.util
import logging
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar, cast

from hil_bench.errors import HilBenchError
from hil_bench.plants.hydraulic_cylinder.model.machine_code import WANTS_PYTHON

logger = logging.getLogger(__name__)

_Kernel = TypeVar("_Kernel", bound=Callable[..., Any])

IS_INSTALLED = importlib.util.find_spec("numba") is not None
"""Whether Numba is there."""

IS_COMPILED = IS_INSTALLED and not WANTS_PYTHON
"""Whether Numba makes machine code of kernels."""


_SOURCES: Final = Path(__file__).parents[2]
_PLANTS: Final = "hil_bench.plants."
_UNCACHED: Final = "each start does, for there is no directory to keep them in"
_KEPT: Final = 3  # caches of other states of the sources


class Floats(Protocol):
    """A mutable row of floats: a float64 array where kernels are compiled, else a list."""

    def __getitem__(self, index: int, /) -> float: ...

    def __setitem__(self, index: int, value: float, /) -> None: ...

    def __len__(self) -> int: ...


class _Late:
    """A kernel that is compiled when it is first used, by a plant or by a kernel that is compiled.

    Numba takes an object for what its `_numba_type_` says: here for the compiled kernel.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        functools.update_wrapper(self, function)
        self._function = function
        self._options = options

    @functools.cached_property
    def compiled(self) -> Callable[..., Any]:
        """The kernel as Numba makes it.

        Raises:
            HilBenchError: Numba is there, but does not run.
        """
        try:
            import numba  # noqa: PLC0415 - half a second, for those who build a plant
            import numpy as np  # noqa: PLC0415 - Numba has imported it
        except ImportError as error:
            remedy = "update it, uninstall it, or set NUMBA_DISABLE_JIT=1"
            raise HilBenchError(f"Numba is there but does not run: {error}; {remedy}") from error
        _watch_compiling()
        self._function.__globals__["np"] = np  # its module need not import it
        compile_with = functools.partial(numba.njit, error_model="numpy", **self._options)
        try:
            with _cached_by_sources(numba.config) as directory:
                is_cached = _has_place(directory)
                return cast("Callable[..., Any]", compile_with(cache=is_cached)(self._function))
        except RuntimeError:  # no directory to cache in: a read-only or zipped installation
            return cast("Callable[..., Any]", compile_with()(self._function))

    @property
    def _numba_type_(self) -> Any:  # noqa: ANN401 - a type of Numba's
        return self.compiled._numba_type_  # type: ignore[attr-defined]

    def __call__(self, *values: Any) -> Any:  # noqa: ANN401 - whatever the kernel takes
        return self.compiled(*values)


@functools.cache
def _watch_compiling() -> None:
    """Announce, once a process, that a kernel is compiled because no cache has it."""
    from numba.core import event  # noqa: PLC0415 - as Numba

    class Announcer(event.Listener):
        has_spoken = False

        def on_start(self, event: Any) -> None:  # noqa: ANN401 - Numba has no types
            function = event.data["dispatcher"].py_func
            if self.has_spoken or not str(function.__module__).startswith(_PLANTS):
                return
            self.has_spoken = True
            cache = event.data["dispatcher"].stats.cache_path
            later = f"later starts load them from {Path(cache).parent}" if cache else _UNCACHED
            logger.info("compiling the plant's kernels for this processor; %s", later)

        def on_end(self, event: Any) -> None:  # noqa: ANN401 - likewise
            pass

    event.register("numba:compile", Announcer())  # type: ignore[no-untyped-call]


@contextmanager
def _cached_by_sources(config: Any) -> Iterator[str]:  # noqa: ANN401 - Numba's, without types
    """Let Numba cache what is decorated meanwhile in a directory of these very sources.

    Yields:
        That directory; empty where Numba chooses.
    """
    given = config.CACHE_DIR
    config.CACHE_DIR = directory = _cache_directory(given)
    try:
        yield directory
    finally:
        config.CACHE_DIR = given


@functools.cache
def _has_place(directory: str) -> bool:
    """Return True if machine code is kept in that directory, or in the user's own.

    For a user without a home Numba takes the folder ``~`` of the present directory, with whatever
    machine code somebody has put there.
    """
    with suppress(RuntimeError):  # there is no home
        given = os.environ.get("XDG_CACHE_HOME")
        if (Path.home() if given is None else Path(given)).is_absolute():
            return True
    with suppress(OSError):
        Path(directory).mkdir(parents=True, exist_ok=True)
    return bool(directory) and os.access(directory, os.W_OK)


@functools.cache
def _cache_directory(given: str) -> str:
    """Return the folder of the present plants' machine code; empty where Numba chooses.

    Args:
        given: NUMBA_CACHE_DIR; empty for none.
    """
    if not _SOURCES.is_dir():  # in a ZIP file
        return given
    parent = Path(given) if given else Path(__file__).parent / "__pycache__"
    directory = parent / f"kernels-{digest_of_sources(_SOURCES)}"
    if not directory.exists():
        others = sorted(parent.glob("kernels-*"), key=lambda each: each.stat().st_mtime)
        for other in others[:-_KEPT]:
            shutil.rmtree(other, ignore_errors=True)
    return str(directory)


def digest_of_sources(folder: Path) -> str:
    """Return a digest of names, sizes and times of all sources in a folder."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        status = path.stat()
        digest.update(
            f"{path.relative_to(folder)} {status.st_size} {status.st_mtime_ns}\n".encode()
        )
    return digest.hexdigest()[:16]


def kernel(function: _Kernel) -> _Kernel:
    """Return the function compiled where Numba is present, and unchanged where it is not."""
    # forceinline: left to itself the compiler passes the larger kernels every constant in memory.
    return _late(function, {"forceinline": True})


def long_kernel(function: _Kernel) -> _Kernel:
    """Return the function as `kernel` does; other threads run meanwhile."""
    return _late(function, {"nogil": True})


def _late(function: _Kernel, options: dict[str, Any]) -> _Kernel:
    return cast("_Kernel", _Late(function, options)) if IS_COMPILED else function


def ready(function: _Kernel) -> _Kernel:
    """Return a kernel for whoever calls it often: compiled, with nothing before it."""
    return cast("_Kernel", function.compiled) if isinstance(function, _Late) else function


def make_row(values: Sequence[float]) -> Floats:
    """Return a row of floats as the kernels take it."""
    if IS_COMPILED:
        import numpy as np  # noqa: PLC0415 - who makes a row runs a plant

        return cast("Floats", np.array(values, dtype=np.float64))
    return list(values)
