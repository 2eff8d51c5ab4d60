"""Hardware-in-the-loop test bench in software for valve-controlled hydraulic cylinders.

What is promised from Python, besides `hil_drivers` and the fixtures of the pytest plugin, is what
this package exports: other modules may change with each version. Nothing is imported before its
first use; `__init__.pyi` has the names with their types.
"""

import sys

_MODULES = {
    "bench.assembly": ("embedded_bus",),
    "bench.configuration": ("BenchConfig", "load_config"),
    "errors": ("BusError", "ConfigError", "HilBenchError", "WaitTimeoutError"),
    "outside.recording.signal_table": ("SignalTable",),
    "session.virtual_bench": ("VirtualBench",),
}

_PLACES = {name: f"{__name__}.{module}" for module, names in _MODULES.items() for name in names}


def _exports() -> dict[str, str]:
    """The modules of the names that abilities export."""
    from hil_bench.ability import own_abilities  # noqa: PLC0415 - see above

    return {name: place for each in own_abilities() for name, place in each.exports.items()}


class _Moved:
    """Finds modules by the names that they had before they went into an ability.

    Args:
        name: that of today.
    """

    def __init__(self, name: str) -> None:
        self._name = name

    @classmethod
    def find_spec(cls, name: str, *_: object) -> object:
        """Find a module, after all others have failed; None where it has not moved."""
        if not name.startswith(f"{__name__}."):
            return None
        from importlib.machinery import ModuleSpec  # noqa: PLC0415 - see above

        from hil_bench.ability import own_abilities  # noqa: PLC0415 - see above

        for old, new in (each for ability in own_abilities() for each in ability.moved.items()):
            if name == old:
                return ModuleSpec(name, None, is_package=True)
            if name.startswith(f"{old}."):
                return ModuleSpec(name, cls(new + name.removeprefix(old)))
        return None

    def create_module(self, _spec: object) -> None:
        """Leave it to the import system: another one is there."""

    def exec_module(self, module: object) -> None:
        """Put the module of today in place of that of the old name."""
        from importlib import import_module  # noqa: PLC0415 - see above

        sys.modules[module.__name__] = import_module(self._name)


sys.meta_path.append(_Moved)


def __getattr__(name: str) -> object:
    """Return an exported name, `__all__` or `__version__`, looked up when it is asked for.

    Raises:
        AttributeError: it is another name.
    """
    if name == "__version__":
        from importlib.metadata import version  # noqa: PLC0415 - takes longer than all the rest

        return version("hil-bench")
    if name == "__all__":
        return [*_PLACES, *_exports()]
    module = _PLACES.get(name)
    if module is None and not name.startswith("_"):
        module = _exports().get(name)
    if module is not None:
        from importlib import import_module  # noqa: PLC0415 - see above

        return getattr(import_module(module), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the public names."""
    return [*_PLACES, *_exports(), "__version__"]
