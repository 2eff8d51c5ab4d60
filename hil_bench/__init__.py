"""Hardware-in-the-loop test bench in software for valve-controlled hydraulic cylinders.

What is promised from Python, besides `hil_drivers` and the fixtures of the pytest plugin, is what
this package exports: other modules may change with each version. Nothing is imported before its
first use; `__init__.pyi` has the names with their types.
"""

_MODULES = {
    "bench.assembly": ("embedded_bus",),
    "bench.configuration": ("BenchConfig", "load_config"),
    "errors": ("BusError", "ConfigError", "HilBenchError", "WaitTimeoutError"),
    "outside.recording.signal_table": ("SignalTable",),
    "bench.virtual_bench": ("VirtualBench",),
}

_PLACES = {name: f"{__name__}.{module}" for module, names in _MODULES.items() for name in names}


def _exports() -> dict[str, str]:
    """The modules of the names that abilities export."""
    from hil_bench.ability import own_abilities  # noqa: PLC0415 - see above

    return {name: place for each in own_abilities() for name, place in each.exports.items()}


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
