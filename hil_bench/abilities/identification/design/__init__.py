"""The design of manoeuvres that tell more of a machine: candidates, their yield, a scenario."""
