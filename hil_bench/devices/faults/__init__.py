"""Faults on purpose: of sensors, valves, supplies and bus connections, in bench time."""
