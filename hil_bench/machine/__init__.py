"""What is done to a machine, virtual or real: commissioning, identification, twin, replay."""
