"""Clocks and the paced loop."""
