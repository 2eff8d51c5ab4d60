"""A program in another process whose SYNC is its clock, over the bench's own hub."""
