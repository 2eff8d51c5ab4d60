"""An unmodified Linux program on CAN sockets and clocks that the bench gives it."""
