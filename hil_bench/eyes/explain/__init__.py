"""What went wrong on a bus: causes first, each with its frames and its clause."""
