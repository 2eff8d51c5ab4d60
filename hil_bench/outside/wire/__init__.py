"""What copper does to frames: their length to the bit, and who sends first (ISO 11898-1)."""
