"""Any FMU for co-simulation (FMI 2.0 and 3.0) as a plant, by FMPy."""
