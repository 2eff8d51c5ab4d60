"""The world outside a bench: buses, files, clocks, and processes beside the loop."""
