"""Scenarios and requirements: tests over time, in files that read like a test plan."""
