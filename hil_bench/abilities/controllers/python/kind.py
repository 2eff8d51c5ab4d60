"""The kind `python`: a function or a class of the user's file."""

import importlib
import importlib.util
import inspect
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hil_bench.abilities.controllers.seam import Controller, ControllerKind, Surroundings
from hil_bench.config.settings import Key
from hil_bench.config.values import quote, text
from hil_bench.errors import ConfigError

if TYPE_CHECKING:
    from hil_bench.abilities.controllers.python.controller import Rig

EXAMPLES = ("position_control", "manual")
"""The controllers of the package; see `hil_bench.abilities.controllers.python.examples`."""

Call = Callable[["Rig"], object]


class PythonKind(ControllerKind):
    """A callable of a file or a module."""

    name = "python"
    summary = "a function or class of a Python file"
    uses_files = False
    is_inside = True
    keys = (Key("call", text, example='"axis.py:control"'),)

    def problems(self, settings: Mapping[str, Any], folder: Path) -> Sequence[str]:
        """Return the fault of the callable, whose file is imported."""
        try:
            find_call(settings["call"], folder)
        except ConfigError as error:
            return [f"call: {error}"]
        return ()

    def build(self, settings: Mapping[str, Any], surroundings: Surroundings) -> Controller:
        """Return a controller that calls it at its first `advance`."""
        from hil_bench.abilities.controllers.python.controller import (  # noqa: PLC0415 - canopen
            PythonController,
        )

        call = settings["call"]
        if isinstance(call, str):
            call = find_call(call, surroundings.folder)
        return PythonController(call, surroundings)


def find_call(place: str, folder: Path) -> Call:
    """Return the callable that ``file.py:name`` or ``module:name`` stands for.

    Args:
        place: of the callable.
        folder: from which the file's path counts.

    Raises:
        ConfigError: there is none, or its file cannot be imported.
    """
    file, _, name = place.rpartition(":")
    if not file or not name.isidentifier():
        raise ConfigError(f'{quote(place)} names nothing; write it as "axis.py:control"')
    module = (
        _import_file(folder / file)
        if file.endswith(".py")
        else _import(file, importlib.import_module)
    )
    found = getattr(module, name, None)
    if not callable(found):
        wrong = "is not there" if found is None else f"is {type(found).__name__}"
        raise ConfigError(f"{file}: {name} {wrong}; give a function or a class")
    try:
        inspect.signature(found).bind(None)
    except TypeError:
        right = f"it is called with the rig, as in def {name}(rig)"
        raise ConfigError(
            f"{file}: {name}{inspect.signature(found)} does not fit; {right}"
        ) from None
    except ValueError:
        pass  # of machine code, which says nothing of its arguments
    call: Call = found
    return call


def _import_file(path: Path) -> object:
    """Import a file, with its folder among those that it may import from.

    Raises:
        ConfigError: it is not there, or fails.
    """
    if not path.is_file():
        raise ConfigError(f"{path}: there is no such file")
    known = sys.modules.get(path.stem)
    if known is not None and getattr(known, "__file__", None) == str(path.resolve()):
        return known
    folder = str(path.resolve().parent)
    if folder not in sys.path:
        sys.path.insert(0, folder)
    spec = importlib.util.spec_from_file_location(f"hil_controller_{path.stem}", path.resolve())
    if spec is None or spec.loader is None:
        raise ConfigError(f"{path}: is no Python file")
    module = importlib.util.module_from_spec(spec)
    loader = spec.loader
    _import(str(path), lambda _: loader.exec_module(module))
    return module


def _import(name: str, load: Callable[[str], object]) -> object:
    """Import what runs the user's code.

    Raises:
        ConfigError: it fails.
        KeyboardInterrupt: Ctrl-C.
    """
    try:
        with redirect_stdout(sys.stderr):
            return load(name)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # whatever ends it, it is its end, not ours
        raise ConfigError(f"{name}: cannot be imported: {type(error).__name__}: {error}") from error


KIND = PythonKind()
