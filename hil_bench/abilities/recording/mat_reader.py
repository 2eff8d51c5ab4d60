"""MAT files of version 7 and before, read in a process of their own.

scipy's reader ends the process (a segmentation fault, a bus error) where a damaged file misleads
it, so it has one that may end: ``python -m`` and this module's name with a FILE writes
the vectors of numbers to standard output, as NumPy's npz.
"""

import io
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hil_bench.errors import ConfigError

if sys.platform != "win32":
    import resource

_PATIENCE = 120.0
"""Longest time for one file [s]."""

_LARGEST = 4 << 30
"""Memory for one file [byte]: a small one may unfold to a thousand times its size."""

_WRONG = 3
"""Exit code where the file is wrong; standard error says why."""


def read_vectors(path: Path) -> dict[str, npt.NDArray[np.float64]]:
    """Return the vectors of numbers of a MAT file by their names.

    Raises:
        ConfigError: it is no such file.
    """
    import_module("scipy")  # an extra: who lacks it reads that, and not of a reader that ended
    command = [sys.executable, "-m", __name__, str(path)]
    try:
        done = subprocess.run(command, capture_output=True, check=False, timeout=_PATIENCE)  # noqa: S603 - ourselves
    except subprocess.TimeoutExpired:
        raise ConfigError(f"it is no MAT file: not read in {_PATIENCE:g} s") from None
    if done.returncode == _WRONG:
        raise ConfigError(done.stderr.decode(errors="replace").strip())
    if done.returncode:
        raise ConfigError(f"it is no MAT file: its reader ended with code {done.returncode}")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as found:
        return {name: found[f"v{number}"] for number, name in enumerate(found["names"].tolist())}


def _main(path: str) -> int:
    """Write the vectors of a file to standard output; return the exit code."""
    if sys.platform != "win32":
        resource.setrlimit(resource.RLIMIT_AS, (_LARGEST, _LARGEST))
    try:
        found = _packed_vectors(path)
    except NotImplementedError:
        sys.stderr.write("it is a MAT file of version 7.3; save it with -v7")
    except MemoryError:
        sys.stderr.write(f"it is no MAT file: to read it takes over {_LARGEST >> 30} GiB")
    except Exception as error:  # whatever a damaged file makes of scipy's reader
        sys.stderr.write(f"it is no MAT file: {error}")
    else:
        sys.stdout.buffer.write(found)
        return 0
    return _WRONG


def _packed_vectors(path: str) -> bytes:
    """Return the vectors of numbers of a MAT file as NumPy's npz."""
    from scipy.io import loadmat  # noqa: PLC0415 - an extra

    vectors = {
        name: np.asarray(values, dtype=np.float64)
        for name, values in loadmat(path, squeeze_me=True).items()
        if isinstance(values, np.ndarray) and values.ndim == 1 and values.dtype.kind in "fiu"
    }
    arrays: dict[str, Any] = {f"v{n}": values for n, values in enumerate(vectors.values())}
    whole = io.BytesIO()
    np.savez(whole, names=np.array([*vectors], dtype=np.str_), **arrays)
    return whole.getvalue()


if __name__ == "__main__":
    raise SystemExit(_main(sys.argv[1]))
