"""Controllers as the program that is flashed, on a simulated Cortex-M with its CAN controller."""
