"""The one place that decides whether the plant's kernels are compiled.

A kernel is a plain function on floats. Where Numba is installed it is compiled to machine code;
where it is not, or where `NUMBA_DISABLE_JIT=1`, the very same source runs as Python.

`fastmath` stays off: without it the compiled kernel does the same IEEE operations in the same order
as the interpreted one, so both give the same bits, and NaN and infinity keep their meaning.
The machine code is cached on disk. Numba sees a change of the file that holds a kernel, but not of
a file that this kernel calls into: after editing one, delete the `__pycache__` beside this file.
"""

from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeVar, cast

import numpy as np

_Kernel = TypeVar("_Kernel", bound=Callable[..., Any])

try:
    import numba
except ImportError:
    IS_COMPILED = False
else:
    IS_COMPILED = not numba.config.DISABLE_JIT  # type: ignore[attr-defined]  # set at import


class Floats(Protocol):
    """A mutable row of floats: a float64 array where kernels are compiled, else a list."""

    def __getitem__(self, index: int, /) -> float: ...

    def __setitem__(self, index: int, value: float, /) -> None: ...

    def __len__(self) -> int: ...


def kernel(function: _Kernel) -> _Kernel:
    """Return the function compiled where Numba is present, and unchanged where it is not."""
    # forceinline: left to itself the compiler passes the larger kernels every constant in memory.
    return _compile(function, {"forceinline": True})


def long_kernel(function: _Kernel) -> _Kernel:
    """Return the function as `kernel` does; other threads run meanwhile."""
    return _compile(function, {"nogil": True})


def _compile(function: _Kernel, options: dict[str, Any]) -> _Kernel:
    if not IS_COMPILED:
        return function
    try:
        compiled = numba.njit(cache=True, error_model="numpy", **options)(function)
    except RuntimeError:  # no directory to cache in: a read-only or zipped installation
        compiled = numba.njit(error_model="numpy", **options)(function)
    return cast("_Kernel", compiled)


def make_row(values: Sequence[float]) -> Floats:
    """Return a row of floats as the kernels take it."""
    if IS_COMPILED:
        return cast("Floats", np.array(values, dtype=np.float64))
    return list(values)
