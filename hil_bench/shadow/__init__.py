"""The twin beside the machine: the bench's plant on the commands that the real valve gets.

`decoder` reads what the machine's sensors say off the bus, `twin` runs the same plant on the frames
that the controller sends, and sets both side by side. Nothing is ever sent.
"""

from hil_bench.shadow.twin import QUANTITIES, Residual, Sample, Shadow, Window

__all__ = ["QUANTITIES", "Residual", "Sample", "Shadow", "Window"]
