"""Kinds of plants: what an axis of the bench moves, whichever model stands behind it."""
