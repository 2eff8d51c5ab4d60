"""Controllers in Python, on the drivers or on plain frames, in the thread of the bench."""
