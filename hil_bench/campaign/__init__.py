"""Thousands of runs of scenarios, and a search for what makes a requirement fail."""
