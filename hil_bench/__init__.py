"""Hardware-in-the-loop test bench in software for valve-controlled hydraulic cylinders."""


def __getattr__(name: str) -> str:
    """Return `__version__`, looked up when it is asked for: that takes longer than all the rest.

    Raises:
        AttributeError: it is another name.
    """
    if name == "__version__":
        from importlib.metadata import version  # noqa: PLC0415 - see above

        return version("hil-bench")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
