"""Reads the frames of a CANopen bus: what each says in words, and what went wrong."""
