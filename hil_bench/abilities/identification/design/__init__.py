"""Which manoeuvre would tell more of a machine: candidates, what each would tell, a scenario."""
