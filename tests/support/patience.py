"""How long tests wait for what must come."""

GUARD = 200.0
"""Ends a wait that would never end [s], before pytest's own limit does: no test is to need it."""
