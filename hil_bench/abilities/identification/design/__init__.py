"""Design of informative manoeuvres: candidates, the information of each, a scenario."""
