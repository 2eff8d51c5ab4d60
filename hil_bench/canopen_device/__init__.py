"""CANopen device side, sans-I/O: frames and time in, frames and the next deadline out (CiA 301)."""
