"""Peripherals of STM32 chips, register by register as their reference manuals give them."""
