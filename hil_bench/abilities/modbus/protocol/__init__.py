"""Modbus without a wire: what a register holds, and which requests a device answers how."""
