"""Controllers that another tool has exported as an FMU, on the drivers of the bench's devices."""
