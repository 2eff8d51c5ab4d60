"""The words that a key of the configuration may have, where it has a choice of some."""

FIRST_BUS = "bus"
"""Name of the bus of the table ``[bus]``."""
