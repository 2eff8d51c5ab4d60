"""Processes beside the loop, and what passes between them and it through shared memory."""
