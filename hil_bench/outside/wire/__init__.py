"""Frames on copper: their length to the bit, and their arbitration (ISO 11898-1)."""
