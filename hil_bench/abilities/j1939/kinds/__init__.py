"""The kinds of J1939 devices."""
