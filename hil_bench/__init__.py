"""Hardware-in-the-loop test bench in software for valve-controlled hydraulic cylinders."""

from importlib.metadata import version

__version__ = version("hil-bench")
