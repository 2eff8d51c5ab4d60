"""The bench: one tick after the other, and how it is built from its configuration."""
