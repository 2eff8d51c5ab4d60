"""An axis of a bench as an FMU for co-simulation (FMI 2.0), for other tools."""
