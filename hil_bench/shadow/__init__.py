"""The twin beside the machine: the bench's plant on the commands that the real valve gets.

`decoder` reads what the machine's sensors say off the bus, `sample_clock` when they measured it;
`twin` runs the same plant on the frames that the controller sends, and `axis_twin` sets both side
by side. Nothing is ever sent.
"""

from hil_bench.shadow.axis_twin import QUANTITIES, Residual
from hil_bench.shadow.twin import Sample, Shadow, Window

__all__ = ["QUANTITIES", "Residual", "Sample", "Shadow", "Window"]
