"""Kinds of devices: one file says all of one kind."""
