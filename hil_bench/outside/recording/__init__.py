"""Recordings of a run: channels, frames and their files."""
